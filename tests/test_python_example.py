"""The example of docs/python.md, run as a reader runs it."""

import re
import subprocess
import sys

from tests.pages import ROOT, blocks_of


def test_the_python_example_finds_a_transfer_and_a_robust_one(tmp_path):
    block = blocks_of(ROOT / "docs" / "python.md", "python")[0]
    (tmp_path / "example.py").write_text(block, encoding="utf-8")
    ran = subprocess.run(
        [sys.executable, "example.py"], cwd=tmp_path, capture_output=True, text=True, timeout=800
    )
    assert ran.returncode == 0, ran.stderr
    *solves, judged = ran.stdout.splitlines()
    solved = [line for line in solves if line[0].isdigit()]
    assert re.match(r"\d+ (OPTIMAL|ACCEPTABLE|FEASIBLE_AT_LIMIT) All defects and bounds hold", solved[-1])
    # Two final masses, of the reference and of the realization, each above what is left after 400 m/s.
    assert re.fullmatch(r"True \[ ?1[23]\d{3}\.\d* +1[23]\d{3}\.\d* *\]", judged)
