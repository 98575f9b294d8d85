import json

import numpy as np
import pytest
import typer

from benchmarks.load import as_json, outcome
from benchmarks.probe import percentile_ms
from benchmarks.service import main
from service.store.store import Store
from tests.service.campaigns import submitted
from workers.messages import JobOutcome


@pytest.fixture
def store(tmp_path):
    with Store(tmp_path) as opened:
        yield opened


def test_simulated_outcomes_are_taken_for_real_ones_of_both_kinds(store):
    submitted(store)
    kinds = set()
    while claims := store.claim("simulated", 3):
        for claim in claims:
            job = json.loads(claim.job.model_dump_json())
            answer = as_json({"outcome": outcome(job, np.random.default_rng(claim.job_id), 1.0)})
            report = JobOutcome.model_validate(json.loads(answer)["outcome"])
            store.complete(claim.ticket, report)
            kinds.add(claim.job.kind)
    s0, s1 = store.campaign(1).searches
    assert kinds == {"hop", "map"} and s0.n_strict == 8 and s1.n_strict == 8


@pytest.mark.parametrize(
    ("times", "share", "expected"),
    [([], 0.5, None), ([0.002], 0.99, 2.0), ([0.001 * n for n in range(1, 101)], 0.99, 100.0)],
)
def test_percentiles_are_those_of_the_ordered_times(times, share, expected):
    assert percentile_ms(times, share) == (None if expected is None else pytest.approx(expected))


def test_a_short_measurement_over_real_processes(tmp_path, capsys):
    folder = tmp_path / "kept"
    main(outcomes=12, workers=3, seconds=120.0, rate=0.0, folder=folder, as_json=True)
    measured = json.loads(capsys.readouterr().out)
    assert measured["n_outcomes"] >= 11 and measured["n_locked"] == 0
    assert measured["completions"]["p99_ms"] > 0 and measured["cpu_ms_per_outcome"] > 0
    taken = {"claim 200", "complete 200", "complete-many 200", "heartbeat 200"}
    assert set(measured["statuses"]) <= taken and measured["load_cpu_ms_per_outcome"] > 0
    assert min(measured["memory_mb"]) > 10 and (tmp_path / "kept" / "coastarc.db").exists()


def test_a_folder_with_something_in_it_is_refused(tmp_path):
    (tmp_path / "mine").write_text("")
    with pytest.raises(typer.BadParameter, match="empty folder"):
        main(folder=tmp_path)
