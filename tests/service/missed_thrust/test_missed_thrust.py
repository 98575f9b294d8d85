"""A missed-thrust analysis as a campaign: what is planned, what is shown, and what real solves find."""

import json
import sys

import numpy as np
import pytest

from core.problem import load_problem, problem_from
from core.verification.verify import verify
from service import cli, logs
from service.cli import run as cli_run
from service.schemas.solution import Filter
from service.solutions.missed_thrust import views_of
from service.spec import SpecError, spec_from
from service.spec.missed_thrust import GridError, analysis_spec, grid_of
from service.spec.spec_check import planned
from service.store.store import Store
from tests.acceptance import known
from tests.service.campaigns import dispatcher_on, finish, submitted
from tests.service.databases import needs_postgres
from workers.executor import Inline
from workers.run import run_job

API = "/api/v1"
PRESET = load_problem("ppe-drm3")
#: Hash of the campaign of known solutions, before seeds could be named and references frozen.
BEFORE = "f1934697360926df91b878ad37739317"


@pytest.mark.parametrize(
    ("segments", "durations", "expected"),
    [
        ("4:12:4", "0.1:0.3:0.1", ((4, 8, 12), (0.1, 0.2, 0.3))),
        ("12, 4", "2", ((4, 12), (2.0,))),
        ("40:49:6", "0.5:1.2:0.5", ((40, 46), (0.5, 1.0))),
    ],
)
def test_outages_are_asked_for_as_ranges_or_lists(segments, durations, expected):
    assert tuple(grid_of(PRESET, segments, durations)) == expected


def test_without_a_wish_it_is_every_other_segment_and_those_of_the_solution():
    grid = grid_of(PRESET.with_outages([(24, 1.0)]))
    assert set(grid.segments) == {*range(1, 50, 2), 24}


@pytest.mark.parametrize(
    ("segments", "durations", "message"),
    [
        ("0:10:2", "1", "segments: expected whole numbers in 1..49, got 0"),
        ("1:50:1", "1", "segments: expected whole numbers in 1..49, got 50"),
        ("2.5", "1", "segments: expected whole numbers in 1..49, got 2.5"),
        ("4", "30", "durations: expected above 0 to 20 days, got 30"),
        ("4", "0:1:0.5", "durations: expected above 0 to 20 days, got 0"),
        ("8:4:1", "1", "segments: expected START <= STOP in up to 400 steps, got 8:4:1"),
        ("four", "1", "segments: expected START:STOP:STEP or numbers with commas, got 'four'"),
    ],
)
def test_outages_that_cannot_be_are_refused_with_a_reason(segments, durations, message):
    with pytest.raises(GridError) as refusal:
        grid_of(PRESET, segments, durations)
    assert str(refusal.value) == message


def test_outages_are_as_long_as_the_bounds_of_the_problem_allow():
    mars = load_problem("earth-mars")
    assert grid_of(mars, "8", "28,60").durations_days == (28.0, 60.0)
    with pytest.raises(GridError, match="durations: expected above 0 to 60 days, got 61"):
        grid_of(mars, "8", "61")
    asked = analysis_spec("0" * 32, mars, grid_of(mars, "8,20", "28"))
    assert [search.outage_sets for search in spec_from(asked).search] == [(((8, 28.0),), ((20, 28.0),))]


def analysis(solution_id, segments="24,30", durations="0.5,1.0", problem=PRESET):
    return analysis_spec(solution_id, problem, grid_of(problem, segments, durations))


def test_each_longer_outage_is_tried_from_the_solution_and_from_the_shorter_one():
    spec = spec_from(analysis("0" * 32, durations="0.5:1.5:0.5"))
    assert [search.id for search in spec.search] == ["0.5d", "1d", "1d-on", "1.5d", "1.5d-on"]
    sources = [search.seeds.full_name for search in spec.search if search.seed_k == 1]
    assert sources == ["0.5d", "1d-on"]
    assert [plan.n_guesses_most for plan in planned(spec)] == [2, 2, 2, 2, 2]
    assert all(search.settings.is_reference_frozen for search in spec.search)


def test_fields_that_came_later_leave_the_hashes_of_older_campaigns_alone():
    fields = known.SPEC | {
        "search": [known.SPEC["search"][0], known.SPEC["search"][1] | {"reference": "free"}]
    }
    assert spec_from(fields).hash == spec_from(known.SPEC).hash == BEFORE
    frozen = known.SPEC["search"][1] | {"reference": "frozen"}
    assert spec_from(known.SPEC | {"search": [known.SPEC["search"][0], frozen]}).hash != BEFORE


@pytest.mark.parametrize(
    ("seeds", "message"),
    [
        ({}, "expected one of `from` and `solution`, got none"),
        ({"from": "a", "solution": "0" * 32}, "expected one of `from` and `solution`, got both"),
        ({"solution": "0" * 32, "campaign": "a"}, "expected beside `from`, got it beside `solution`"),
        ({"solution": "4719a1a0"}, "expected 32 hexadecimal digits, a whole id, got '4719a1a0'"),
    ],
)
def test_seeds_come_from_one_place(seeds, message):
    fields = analysis("0" * 32)
    fields["search"][0]["seeds"] = seeds
    with pytest.raises(SpecError, match="seeds") as refusal:
        spec_from(fields)
    assert message in str(refusal.value)


def test_a_solution_that_is_not_there_is_refused(store):
    with pytest.raises(SpecError, match="expected a solution of this archive, got 0000"):
        store.submit(spec_from(analysis("0" * 32)))


@pytest.fixture
def archive(store):
    """Known solutions of P_0 and of P_1, as an earlier campaign left them."""
    known.submitted(store)
    dispatcher = known.dispatcher(store)
    while dispatcher.step() or store.campaign_state(1) != "done":
        pass
    return store


def first(archive, k):
    return archive.all_records(Filter(k=k))[0]


@pytest.mark.parametrize(
    "store",
    ["sqlite", pytest.param("postgresql", marks=[pytest.mark.postgres, needs_postgres])],
    indirect=True,
)
def test_of_a_robust_solution_the_reference_alone_is_the_seed(store):
    submitted(store)
    finish(store)
    record = store.all_records(Filter(k=1, strict=True))[0]
    campaign_id, _ = store.submit(spec_from(analysis(record.id)))
    (claim, *_) = store.claim("node7:1", 1, campaign_id)
    assert claim.job.seed_id == record.id and claim.job.settings.is_reference_frozen
    assert claim.job.seed_problem["outages"] == []
    assert claim.job.seed_x == tuple(record.x[:154])


def analysed(archive, record, **wanted):
    campaign_id, _ = archive.submit(spec_from(analysis(record.id, **wanted)))
    dispatcher = dispatcher_on(archive, Inline(run_job))
    while dispatcher.step() or archive.campaign_state(campaign_id) != "done":
        pass
    (view,) = views_of(archive, record.id, campaign_id)
    return view


def test_real_recoveries_become_solutions_of_p_1_and_a_map(archive, client):
    record = first(archive, 0)
    assert client.get(f"{API}/solutions/{record.id}/missed-thrust").json() == {"items": []}
    view = analysed(archive, record, segments="24", durations="1.0")
    (found,) = archive.all_records(Filter(campaign=2))
    problem = problem_from(archive.definition_and_vector(found.id)[0])
    assert verify(problem, np.array(found.x)).strict
    assert found.x[:154] == record.x and found.seed_id == record.id
    assert view.propellant_kg == [[found.x[153] - found.x[-1]]] and view.n_done == view.n_jobs == 1
    assert client.get(f"{API}/solutions/{record.id}/missed-thrust").json()["items"] == [
        json.loads(view.model_dump_json())
    ]


@pytest.fixture
def coastarc(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cli_run, "RUNNER", "tests.workers.fake:run_fake")
    monkeypatch.setattr(logs, "configure", lambda **_: None)
    monkeypatch.chdir(tmp_path)

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["coastarc", *words, "--data", str(tmp_path)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    return call


@pytest.fixture
def solution(tmp_path):
    """Id of a made-up solution with a made-up seed, in an archive on disk."""
    with Store(tmp_path) as store:
        submitted(store)
        finish(store)
        return store.all_records(Filter(k=1, strict=True))[0].id


def analyse(coastarc, solution, *words):
    grid = ("--segments", "4,8", "--durations", "0.5,1")
    return coastarc("analyse", "missed-thrust", solution, *grid, *words)


def test_the_command_maps_a_solution_beside_its_seed(coastarc, solution, tmp_path):
    code, out, _ = analyse(coastarc, solution[:8], "--beside", "seed", "--out", str(tmp_path / "page"))
    assert code == 0 and "longest outage" in out.replace("\n", " ") and "fragile" in out
    text = (tmp_path / "page" / "report.html").read_text(encoding="utf-8")
    assert text.count("<figure") == 5 and solution[:8] in text
    assert (tmp_path / "page" / "parts" / "longest.png").stat().st_size > 10_000
    code, out, _ = analyse(coastarc, solution, "--json")
    shown = json.loads(out)
    assert code == 0 and shown["n_done"] == shown["n_jobs"] > 0
    assert [row["segment"] for row in shown["segments"]] == [4, 8]


def test_the_command_refuses_in_one_line(coastarc, solution):
    code, _, err = analyse(coastarc, "ffffffff")
    assert code == 2 and "solution ffffffff: expected one that exists" in err
    code, _, err = coastarc("analyse", "missed-thrust", solution, "--segments", "60")
    assert code == 2 and "segments: expected whole numbers in 1..49, got 60" in err
