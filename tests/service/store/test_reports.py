"""Several outcomes in one request: all are taken, or none."""

import pytest

from tests.service.by_hand import work_off, worker_info
from tests.service.campaigns import submitted
from tests.service.databases import rows
from tests.workers.fake import run_fake
from workers.messages import CompleteManyRequest, CompleteRequest, StaleAttemptError


def claimed(store, n_jobs):
    """Return reports of some jobs that were claimed."""
    claims = store.claim(worker_info(), n_jobs)
    return [CompleteRequest(**claim.ticket._asdict(), outcome=run_fake(claim.job)) for claim in claims]


def body(reports):
    return CompleteManyRequest(reports=tuple(reports)).model_dump(mode="json")


def test_several_outcomes_give_what_they_give_one_by_one(store, tmp_path_factory):
    def contents(one):
        return [
            rows(one, f"SELECT {columns} FROM {table} ORDER BY {columns}")
            for table, columns in (
                ("job", "search_id, chain, state"),
                ("solution", "id"),
                ("seed_link", "solution_id, seed_id, mapping"),
                ("tally", "search_id, noun, name, number"),
                ("search", "id, n_planned, n_solves, state"),
            )
        ]

    submitted(store)
    while reports := claimed(store, 3):
        assert [answer.state for answer in store.complete_many(reports)] == ["done"] * len(reports)
    other = type(store)(tmp_path_factory.mktemp("one-by-one"))
    submitted(other)
    work_off(other)
    assert contents(store) == contents(other)
    other.close()


def test_with_a_stale_report_among_them_none_is_stored(store):
    submitted(store)
    reports = claimed(store, 2)
    stale = reports[0].model_copy(update={"attempt": 7})
    with pytest.raises(StaleAttemptError):
        store.complete_many([reports[1], stale])
    assert rows(store, "SELECT count(*) FROM solve") == [(0,)]
    assert [answer.state for answer in store.complete_many(reports)] == ["done", "done"]


def test_a_report_that_is_repeated_within_a_request_gets_its_answer_twice(store):
    submitted(store)
    (report,) = claimed(store, 1)
    first, again = store.complete_many([report, report])
    assert first == again and store.complete_many([report]) == [first]


def test_many_reports_are_answered_in_their_order_and_a_stale_one_with_a_conflict(client, store):
    submitted(store)
    reports = claimed(store, 3)[::-1]
    answer = client.post("/api/v1/jobs/complete-many", json=body(reports))
    assert [one["job_id"] for one in answer.json()["answers"]] == [report.job_id for report in reports]
    (late,) = claimed(store, 1)
    refused = client.post("/api/v1/jobs/complete-many", json=body([late.model_copy(update={"attempt": 9})]))
    assert refused.status_code == 409 and refused.json()["code"] == "stale_attempt"
