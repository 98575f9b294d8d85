"""The notebook, executed by Jupyter's own kernel as a reader executes it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
NOTEBOOK = ROOT / "docs" / "notebook" / "robust_transfer.ipynb"


def texts(cell):
    """Return what a cell printed."""
    return "".join("".join(output.get("text", "")) for output in cell.get("outputs", []))


def pictures(notebook):
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    return sum("image/png" in output.get("data", {}) for cell in cells for output in cell["outputs"])


def printed(notebook):
    return "".join(texts(cell) for cell in notebook["cells"])


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    """The notebook as it comes out of a kernel of its own, which stops at the first error."""
    copy = tmp_path_factory.mktemp("notebook") / NOTEBOOK.name
    copy.write_bytes(NOTEBOOK.read_bytes())
    # In a process of its own, since Jupyter's warnings are no business of ours.
    program = Path(sys.executable).with_name("jupyter-execute")
    command = [str(program), "--inplace", "--timeout=240", str(copy)]
    folders = {name: str(copy.parent) for name in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR")}
    ran = subprocess.run(
        command,
        env=os.environ | folders | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    return json.loads(copy.read_text(encoding="utf-8"))


def test_the_notebook_runs_from_a_guess_to_a_robust_transfer(executed):
    told = printed(executed)
    assert told.count("strict: True") == 2
    assert "our solution is feasible to pygmo: True" in told


def test_every_picture_is_drawn(executed):
    assert pictures(executed) == 3


def test_what_a_reader_sees_without_running_it_came_from_these_cells():
    stored = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert pictures(stored) == 3 and printed(stored).count("strict: True") == 2
    counts = [cell["execution_count"] for cell in stored["cells"] if cell["cell_type"] == "code"]
    assert counts == list(range(1, len(counts) + 1))


def test_the_notebook_names_no_machine_and_needs_no_service():
    text = NOTEBOOK.read_text(encoding="utf-8")
    assert "/home" not in text and "/tmp" not in text and "/root" not in text
    sources = ["".join(cell["source"]) for cell in json.loads(text)["cells"]]
    assert not any("import service" in source or "from service" in source for source in sources)
