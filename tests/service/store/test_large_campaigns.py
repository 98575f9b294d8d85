"""A large campaign is stored in pieces: others write in between, and who finds it half planned goes on."""

import threading

import pytest
from sqlalchemy import select

from core.problem import definitions_of, hashes_of, load_problem
from service.coordinator.coordinator import finish_planning
from service.db.engine import Moment
from service.db.tables import CaseRow, JobRow, ProblemRow, SearchRow
from service.spec import spec_from
from service.store import planning
from service.store.errors import KeyReusedError
from service.store.store import Store
from tests.service.campaigns import spec_fields, submitted
from tests.workers.jobs import worker_info

N_SEARCHES, N_CASES = 20, 40
WORKER = worker_info("test", slots=1)


class Killed(BaseException):
    """The end of a process."""


def large_fields():
    """Return more searches and more cases than are stored at once."""
    searches = [
        {
            "id": f"s{i}",
            "strategy": "S(1)",
            "cases": [[segment] for segment in range(1, N_CASES + 1)],
            "duration_days": 1.0 + i / 8,
            "guesses": 2 * N_CASES,
        }
        for i in range(N_SEARCHES)
    ]
    fed = {
        "id": "fed",
        "strategy": "S(2|1)",
        "cases": [[1, 2]],
        "duration_days": 1.0,
        "seeds": {"from": "s0"},
    }
    return spec_fields(search=[fed, *searches])


def rows_of(store):
    """Return all that planning stores, without times and without the numbers of rows."""
    columns = (JobRow.kind, JobRow.case_index, JobRow.chain, JobRow.hop, JobRow.n_hops, JobRow.state)
    with store._database.read() as session:
        jobs = session.execute(select(SearchRow.name, *columns).join(SearchRow).order_by(JobRow.id)).all()
        cases = session.execute(select(CaseRow.search_id, CaseRow.position, CaseRow.problem_hash)).all()
        problems = {row.hash: row.definition for row in session.scalars(select(ProblemRow))}
        searches = session.execute(select(SearchRow.name, SearchRow.state, SearchRow.n_planned)).all()
    return jobs, cases, problems, searches


@pytest.fixture
def at_once(tmp_path_factory, monkeypatch):
    """Return what one transaction for all of it stores."""
    with monkeypatch.context() as patch, Store(tmp_path_factory.mktemp("at-once")) as store:
        patch.setattr(planning, "MOST_CASES_AT_ONCE", 10_000)
        patch.setattr(planning, "MOST_SEARCHES_AT_ONCE", 10_000)
        submitted(store, large_fields())
        return rows_of(store)


def test_the_pieces_are_what_one_transaction_stores(store, at_once):
    submitted(store, large_fields())
    assert rows_of(store) == at_once
    assert len(at_once[0]) == N_SEARCHES * 2 * N_CASES
    assert {state for name, state, _ in at_once[3] if name != "fed"} == {"active"}


def test_workers_have_their_turn_between_the_pieces(store):
    submitted(store, spec_fields(guesses=40))
    (held,) = store.claim(WORKER, 1, campaign=1)
    answered = []

    def work_of_others(moment):
        if moment is not Moment.AFTER_COMMIT or threading.current_thread().name == "worker":
            return
        worker = threading.Thread(target=turn, name="worker")
        worker.start()
        worker.join(60)

    def turn():
        ticket = held.ticket
        heartbeat = store.heartbeat(WORKER, [ticket])
        claims = store.claim(WORKER, 1, campaign=1)
        answered.append((len(claims), heartbeat, store.campaigns()[0].n_jobs))

    store._database.hook = work_of_others
    submitted(store, large_fields())
    # Two pieces of problems, the campaign, three of searches.
    assert len(answered) == 6
    assert all(n_claims == 1 and not heartbeat.not_held for n_claims, heartbeat, _ in answered)
    n_jobs = [n for _, _, n in answered[2:]]
    assert n_jobs == sorted(set(n_jobs)) and n_jobs[0] == 0 and n_jobs[-1] == N_SEARCHES * 2 * N_CASES


@pytest.mark.parametrize("n_writes", range(1, 6))
def test_what_a_killed_coordinator_left_is_finished_at_the_next_start(tmp_path, at_once, n_writes):
    left = iter(range(n_writes - 1, -1, -1))

    def kill(moment):
        if moment is Moment.AFTER_COMMIT and next(left) == 0:
            raise Killed

    with Store(tmp_path) as store:
        store._database.hook = kill
        with pytest.raises(Killed):
            store.submit(spec_from(large_fields()), "key")
    with Store(tmp_path) as store:
        finish_planning(store, threading.Event())
        # Before the campaign is stored the user hears of no success, and submits it again.
        assert store.submit(spec_from(large_fields()), "key") == (1, n_writes < 3)
        assert rows_of(store) == at_once
        assert store.unplanned() == []


def test_a_key_means_the_campaign_while_it_is_planned(store):
    spec = spec_from(large_fields())
    assert store.begin_campaign(spec, "key") == (1, True)
    assert store.unplanned() == [1]
    assert store.begin_campaign(spec, "key") == (1, False)
    with pytest.raises(KeyReusedError):
        store.begin_campaign(spec_from(spec_fields()), "key")
    assert {search.state for search in store.campaign(1).searches} == {"waiting"}
    store.plan_rest(1)
    assert store.unplanned() == []


def test_a_cancelled_campaign_is_planned_no_further(store):
    store.begin_campaign(spec_from(large_fields()))
    store.control_campaign(1, "cancel")
    store.plan_rest(1)
    view = store.campaign(1)
    assert view.state == "cancelled" and view.n_jobs == 0


def test_a_large_campaign_is_accepted_before_it_is_planned(client, store):
    large = client.post("/api/v1/campaigns", json=large_fields(), headers={"Idempotency-Key": "key"})
    assert large.status_code == 202 and large.headers["location"] == "/api/v1/campaigns/1"
    assert large.json()["state"] == "active" and large.json()["n_jobs"] == 0
    # The test client returns when what follows the answer is done as well.
    assert store.unplanned() == []
    assert store.campaign(1).n_jobs == N_SEARCHES * 2 * N_CASES
    again = client.post("/api/v1/campaigns", json=large_fields(), headers={"Idempotency-Key": "key"})
    assert again.status_code == 200 and again.json()["id"] == 1
    assert client.post("/api/v1/campaigns", json=spec_fields()).status_code == 201


def test_cases_together_are_the_problems_of_each_alone():
    problem = load_problem("ppe-drm3")
    cases = [[], [(24, 1.0)], [(30, 2.5), (3, 1.0)], [(3, 1.0), (3, 0.5)]]
    alone = [problem.with_outages(case) for case in cases]
    together = problem.with_cases(cases)
    assert together == alone
    assert hashes_of(together) == hashes_of(alone) == [one.hash for one in alone]
    assert [list(one) for one in definitions_of(together)] == [list(one.model_dump()) for one in alone]
    assert definitions_of(together) == [one.model_dump(mode="json") for one in alone]


@pytest.mark.parametrize("case", [[(50, 1.0)], [(3, 1.0), (3, 1.0)], [(3, 21.0)]])
def test_an_impossible_case_is_refused_in_the_same_words(case):
    problem = load_problem("ppe-drm3")
    with pytest.raises(ValueError) as alone:
        problem.with_outages(case)
    with pytest.raises(ValueError) as together:
        problem.with_cases([[(24, 1.0)], case])
    assert str(together.value) == str(alone.value)
