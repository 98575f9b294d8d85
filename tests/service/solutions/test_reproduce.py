"""A solution found again: with the fake runner, with the real solver, and where it does not work."""

import json

import pytest
from typer.testing import CliRunner

from service.cli import app_of
from service.cli import solution_commands as cli_reproduce
from service.schemas.solution import Filter
from service.solutions.reproduce import reproduce, verdict
from service.store.store import Store
from tests.acceptance.known import SPEC, VECTORS
from tests.service.campaigns import dispatcher_on, finish, spec_fields, submitted
from tests.workers.fake import PROVENANCE, run_fake
from workers.executor import Inline
from workers.messages import Ending, HopJob, JobOutcome
from workers.run import run_job

API = "/api/v1"


@pytest.fixture
def finished(store):
    submitted(store, spec_fields(guesses=12))
    finish(store)
    return store


def test_every_solution_of_a_campaign_is_found_again_from_its_job_alone(finished):
    for record in finished.all_records(Filter()):
        wanted = finished.reproduction(record.id)
        comparison = reproduce(type(wanted).model_validate_json(wanted.model_dump_json()), run_fake)
        assert comparison.is_same and comparison.found_id == record.id and comparison.differences == []


def test_a_chain_is_run_no_further_than_to_its_solution(finished):
    jobs = [finished.reproduction(record.id) for record in finished.all_records(Filter(search="s0"))]
    assert {wanted.job.n_hops for wanted in jobs} == {1, 2}
    assert all(wanted.hop == wanted.job.address.hop + wanted.job.n_hops - 1 for wanted in jobs)


def changed(job, **change):
    outcome = run_fake(job)
    last = outcome.solves[-1]
    x = (*last.x[:3], last.x[3] + 1e-9, *last.x[4:])
    return outcome.model_copy(update={"solves": (*outcome.solves[:-1], last.model_copy(update={"x": x}))})


def test_one_number_that_differs_is_counted_and_measured(finished):
    wanted = finished.reproduction(finished.all_records(Filter())[0].id)
    comparison = reproduce(wanted, changed)
    assert not comparison.is_same and comparison.n_different == 1
    assert comparison.largest_difference == pytest.approx(1e-9, rel=1e-6)  # a throttle, in 0 .. 1
    assert "1 of" in verdict(comparison)


def test_a_solve_that_fails_now_says_with_what(finished):
    wanted = finished.reproduction(finished.all_records(Filter())[0].id)
    failed = JobOutcome(
        ending=Ending.ERROR, error="Traceback ...\nZeroDivisionError: oh", provenance=PROVENANCE
    )
    comparison = reproduce(wanted, lambda job: failed)
    assert not comparison.is_same and comparison.found_id is None
    assert "ZeroDivisionError: oh" in verdict(comparison)


def test_other_code_and_packages_are_named(finished):
    wanted = finished.reproduction(finished.all_records(Filter())[0].id)
    other = wanted.model_copy(update={"code_version": "0+older", "package_versions": {"numpy": "1"}})
    found = {row.what: (row.then, row.now) for row in reproduce(other, run_fake).differences}
    assert found == {"code": ("0+older", "0+fake"), "package numpy": ("1", "2")}


def seeded_by_a_known_vector(job, stop=lambda: False):
    """Answer to hops as the campaign of known solutions does, and solve what they seed really."""
    from tests.acceptance.known import run_known

    return run_known(job) if isinstance(job, HopJob) else run_job(job, stop)


def test_the_real_solver_finds_a_mapped_solution_again_bit_for_bit(store):
    submitted(store, SPEC)
    work = dispatcher_on(store, Inline(seeded_by_a_known_vector))
    while not store.all_records(Filter(search="s1-0")):
        work.step()
    record = store.all_records(Filter(search="s1-0"))[0]
    comparison = reproduce(store.reproduction(record.id), run_job)
    assert comparison.is_same and comparison.n_variables == len(VECTORS["S(1|0)"][0])
    assert comparison.differences == []


def test_the_command_says_the_same_and_ends_with_zero(finished, monkeypatch):
    monkeypatch.setattr(cli_reproduce, "_runner", run_fake)
    record = finished.all_records(Filter())[0]
    arguments = ["solutions", "reproduce", record.id[:10], "--data", str(finished.folder)]
    done = CliRunner().invoke(app_of(), arguments)
    assert done.exit_code == 0 and "agree in every bit" in done.output
    told = json.loads(CliRunner().invoke(app_of(), [*arguments, "--json"]).output)
    assert told["is_same"] and told["id"] == record.id


def test_the_command_ends_with_one_where_a_bit_differs(finished, monkeypatch):
    monkeypatch.setattr(cli_reproduce, "_runner", changed)
    record = finished.all_records(Filter())[0]
    done = CliRunner().invoke(app_of(), ["solutions", "reproduce", record.id, "--data", str(finished.folder)])
    assert done.exit_code == 1 and "Another vector" in done.output


def test_the_route_gives_the_job_of_a_solution_and_404_for_none(client, finished):
    record = finished.all_records(Filter(search="s1-0"))[0]
    answer = client.get(f"{API}/solutions/{record.id}/reproduction").json()
    assert answer["job"]["kind"] == "map" and answer["job"]["seed_id"] == record.seed_id
    assert answer["x"] == record.x
    assert client.get(f"{API}/solutions/{32 * '0'}/reproduction").status_code == 404


def test_an_archive_of_another_machine_is_read_like_an_own_one(finished):
    with Store(finished.folder, read_only=True) as again:
        record = again.all_records(Filter())[0]
        assert again.reproduction(record.id) == finished.reproduction(record.id)
