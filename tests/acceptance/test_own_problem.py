"""The problem of one's own that docs/own-problem.md works through: its files, and the result it ends with."""

import json
import re
import runpy
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
import spiceypy

from core.ephemeris import furnish
from core.verification.verify import verify
from service.spec import load_spec
from service.spec.spec_check import require_flyable
from tests.pages import ROOT, blocks_of, text_of

PAGE = ROOT / "docs" / "own-problem.md"
EXAMPLE = ROOT / "examples" / "relay"
RESULT = json.loads((Path(__file__).parent / "relay.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A copy of the example, with its target made as the page makes it."""
    folder = tmp_path_factory.mktemp("relay")
    for name in ("orbit.py", "relay.toml"):
        shutil.copy(EXAMPLE / name, folder)
    runpy.run_path(str(folder / "orbit.py"))
    return folder


def test_the_page_and_the_example_are_the_same_campaign():
    on_the_page = tomllib.loads("\n".join(blocks_of(PAGE, "toml")))
    assert on_the_page == tomllib.loads(text_of(EXAMPLE / "relay.toml"))


def test_the_target_is_a_retrograde_orbit_of_the_moon_throughout(folder):
    furnish(folder / "orbit.bsp")
    begin = spiceypy.str2et("2027-01-01 00:00:00 TDB")
    for day in range(300):
        state = spiceypy.spkezr("-90001", begin + 86400.0 * day, "J2000", "NONE", "MOON")[0]
        moon = spiceypy.spkezr("MOON", begin + 86400.0 * day, "J2000", "NONE", "EARTH")[0]
        assert 30_000 < np.linalg.norm(state[:3]) < 60_000
        # Retrograde: it turns against the Moon's own way round the Earth.
        assert np.cross(state[:3], state[3:]) @ np.cross(moon[:3], moon[3:]) < 0


def test_a_relative_target_is_looked_for_beside_the_file_from_any_folder(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    problem = load_spec(folder / "relay.toml").problem
    assert problem.target.path == (folder / "orbit.bsp").resolve()
    require_flyable(problem)


@pytest.mark.parametrize("result", RESULT, ids=lambda result: result["strategy"])
def test_the_result_of_the_page_is_a_verified_solution(result, folder):
    problem = load_spec(folder / "relay.toml").problem
    outages = [(outage["segment"], outage["duration_days"]) for outage in result["outages"]]
    found = verify(problem.with_outages(outages), np.array(result["x"]))
    assert found.strict
    assert f"{result['propellant_kg']:.2f}" in re.sub(r"\s+", " ", text_of(PAGE))
