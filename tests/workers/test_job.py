import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.workers.fake import part_of, run_fake
from tests.workers.jobs import PROBLEM, hop_job
from workers.messages import (
    Address,
    Claim,
    CompleteRequest,
    Ended,
    Finished,
    HandedIn,
    HandInRequest,
    HopJob,
    JobSettings,
    MapJob,
    Reached,
    SealedSolve,
    Ticket,
    packed,
    sealed,
    unpacked,
)
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


def test_an_outcome_crosses_a_pipe_and_the_network_with_its_solves_unread():
    outcome = run_fake(hop_job(n_hops=6))
    carried = unpacked(Ended, json.loads(json.dumps(packed(sealed(Ended, outcome)))))
    assert carried.head.ending is outcome.ending and [solve.hop for solve in carried.solves] == [*range(6)]
    for digest in (None, "0" * 32):
        arrived = CompleteRequest.model_validate_json(Finished(Ticket(3, 1), carried, digest).to_json())
        assert arrived == CompleteRequest(job_id=3, attempt=1, outcome=outcome, job_digest=digest)
    # Whoever carries a solve would carry one that cannot be read as well.
    torn = Finished(Ticket(3, 1), carried._replace(solves=(SealedSolve(0, "{"),)))
    assert torn.to_json().endswith('"solves":[{]}}')


def test_hops_of_a_chain_that_goes_on_cross_a_pipe_and_the_network():
    part = part_of(hop_job(n_hops=6), (1, 2), 3)
    carried = unpacked(Reached, json.loads(json.dumps(packed(sealed(Reached, part)))))
    arrived = HandInRequest.model_validate_json(HandedIn(Ticket(3, 1), carried).to_json())
    assert arrived == HandInRequest(job_id=3, attempt=1, part=part)


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
        JobSettings(cpu_seconds=seconds)


def test_the_environment_of_a_solve_names_one_thread_everywhere():
    environment = single_threaded({"OMP_NUM_THREADS": "8", "HOME": "/nowhere"})
    assert environment["HOME"] == "/nowhere"
    assert {environment[name] for name in THREAD_VARIABLES} == {"1"}
