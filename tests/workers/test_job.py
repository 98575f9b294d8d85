import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.workers.fake import run_fake
from tests.workers.jobs import PROBLEM, hop_job
from workers.messages import Address, Claim, HopJob, JobOutcome, MapJob, Settings
from workers.process_tree import THREAD_VARIABLES, single_threaded

FLOATS = st.floats(allow_nan=False, allow_infinity=False)


@given(x=st.lists(FLOATS, min_size=1, max_size=20), chain=st.integers(0, 2**128 - 1))
def test_a_map_job_crosses_a_pipe_bit_by_bit(x, chain):
    problem = PROBLEM.model_dump(mode="json")
    job = MapJob(
        problem=problem,
        rng_seed=1,
        address=Address(search=1, chain=chain),
        seed_id=f"{chain:032x}",
        seed_problem=problem,
        seed_x=tuple(x),
        mapping="aligned",
    )
    claim = Claim(job_id=1, attempt=1, job=job)
    again = Claim.model_validate(json.loads(json.dumps(claim.model_dump(mode="json"))))
    assert again == claim and [float(a).hex() for a in again.job.seed_x] == [float(a).hex() for a in x]


def test_an_outcome_crosses_a_pipe():
    outcome = run_fake(hop_job(n_hops=6))
    assert JobOutcome.model_validate(json.loads(json.dumps(outcome.model_dump(mode="json")))) == outcome


def test_the_kind_of_a_job_decides_its_type():
    fields = hop_job().model_dump(mode="json")
    assert isinstance(Claim(job_id=1, attempt=1, job=fields).job, HopJob)
    with pytest.raises(ValidationError):
        Claim(job_id=1, attempt=1, job=fields | {"kind": "shell"})


@pytest.mark.parametrize("change", [{"n_hops": 0}, {"rng_seed": -1}, {"colour": "red"}])
def test_a_job_that_cannot_be_is_refused(change):
    with pytest.raises(ValidationError):
        hop_job(**change)


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), float("inf")])
def test_a_cap_is_a_positive_number(seconds):
    with pytest.raises(ValidationError):
        Settings(cpu_seconds=seconds)


def test_the_environment_of_a_solve_names_one_thread_everywhere():
    environment = single_threaded({"OMP_NUM_THREADS": "8", "HOME": "/nowhere"})
    assert environment["HOME"] == "/nowhere"
    assert {environment[name] for name in THREAD_VARIABLES} == {"1"}
