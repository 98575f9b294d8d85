import re
from types import SimpleNamespace

import pytest
from rich.console import Console

from service.cli import terminal
from service.store.store import Store
from tests.service.campaigns import finish, submitted


@pytest.fixture(scope="module")
def view(tmp_path_factory):
    with Store(tmp_path_factory.mktemp("archive")) as store:
        submitted(store)
        finish(store)
        return store.campaign(1)


def printed(table):
    console = Console(width=100, color_system=None)
    with console.capture() as capture:
        console.print(table)
    return capture.get()


def test_the_summary_of_a_run_calls_the_tolerances_loose_and_strict_and_gives_their_numbers(view):
    text = printed(terminal.summary(view))
    assert re.search(r"loose, % +strict, %", text) and "paper" not in text
    assert "loose: 1 km, 100 m/s, 1 kg; strict: 0.1 km, 0.1 m/s, 0.01 kg" in text


@pytest.mark.parametrize(
    ("paper", "strict", "is_marginal", "expected"),
    [
        (True, True, False, "strict"),
        (True, False, False, "loose"),
        (True, False, True, "loose, marginal"),
        (False, False, False, "infeasible"),
    ],
)
def test_the_level_of_a_solution_is_strict_or_loose(paper, strict, is_marginal, expected):
    record = SimpleNamespace(paper=paper, strict=strict, is_marginal=is_marginal)
    assert terminal.level_of(record) == expected


def test_a_verified_solution_is_called_loose():
    item = SimpleNamespace(
        solution_id="5f7f543a" * 8, level="paper", is_good=True, hash=None,
        arrival_miss_km=1.0, earth_altitude_km=None, moon_altitude_km=None,
    )  # fmt: skip
    assert " loose " in printed(terminal.verified_list([item]))
