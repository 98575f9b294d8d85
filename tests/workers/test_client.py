"""What a coordinator answers, and what a dispatcher makes of it."""

import json

import httpx
import pytest

from tests.workers.fake import run_fake
from tests.workers.jobs import hop_job, worker_info
from workers.client import Api, ApiError, HttpSource
from workers.messages import (
    Claim,
    ClaimAnswer,
    ClaimRequest,
    Ended,
    FaultyError,
    Finished,
    HeartbeatRequest,
    HeldJob,
    RefusedError,
    StaleAttemptError,
    Ticket,
    UnacceptableError,
    UnreachableError,
    sealed,
)

REPORT = Finished(Ticket(1, 2), sealed(Ended, run_fake(hop_job())))
CLAIM = ClaimRequest(worker=worker_info(), n_jobs=1)


def source_of(answer, asked=None):
    """Return a source whose coordinator gives one answer to everything."""

    def respond(request):
        if asked is not None:
            asked.append(request)
        if isinstance(answer, Exception):
            raise answer
        return answer

    return HttpSource(Api("http://node7:8741/", "a-token", transport=httpx.MockTransport(respond)))


def refusal(status, code=None, headers=None):
    fault = {"title": "-", "status": status, "detail": f"no, {status}", "code": code}
    return httpx.Response(status, json=fault, headers=headers)


def test_a_claim_is_asked_with_the_token_and_answered_with_jobs():
    asked = []
    answer = ClaimAnswer(claims=(Claim(job_id=1, attempt=1, job=hop_job()),), lease_s=30.0, heartbeat_s=10.0)
    source = source_of(httpx.Response(200, text=answer.model_dump_json()), asked)
    assert source.claim(CLAIM) == answer
    assert str(asked[0].url) == "http://node7:8741/api/v1/jobs/claim"
    assert asked[0].headers["authorization"] == "Bearer a-token"
    assert ClaimRequest.model_validate(json.loads(asked[0].content)) == CLAIM


def test_a_heartbeat_says_all_that_is_held():
    asked, held = [], (HeldJob(job_id=1, attempt=2), HeldJob(job_id=3, attempt=1))
    answer = {"extended": [], "to_cancel": [], "not_held": [{"job_id": 1, "attempt": 2}]}
    source = source_of(httpx.Response(200, json=answer), asked)
    assert source.heartbeat(HeartbeatRequest(worker=worker_info(), held=held)).not_held == held[:1]
    assert len(json.loads(asked[0].content)["held"]) == 2


@pytest.mark.parametrize(
    ("answer", "error"),
    [
        (refusal(409, "stale_attempt"), StaleAttemptError),
        (refusal(409, "worker_refused"), RefusedError),
        (refusal(401), RefusedError),
        (refusal(403), RefusedError),
        (refusal(413), UnacceptableError),
        (refusal(422), UnacceptableError),
        (refusal(404), UnacceptableError),
        (refusal(500), FaultyError),
        (refusal(503), UnreachableError),
        (httpx.Response(502, text="<html>a proxy</html>"), UnreachableError),
        (httpx.Response(200, text="<html>a page</html>"), RefusedError),
        (httpx.Response(302, headers={"Location": "http://elsewhere/"}), RefusedError),
        (httpx.ConnectError("connection refused"), UnreachableError),
        (httpx.ReadTimeout("timed out"), UnreachableError),
        (httpx.RemoteProtocolError("closed"), UnreachableError),
    ],
)
def test_each_answer_to_a_report_says_what_to_do_next(answer, error):
    with pytest.raises(error) as raised:
        source_of(answer).complete(REPORT)
    assert type(raised.value) is error


def test_a_claim_that_is_refused_is_not_asked_again():
    for status in (404, 413, 422):
        with pytest.raises(RefusedError, match=f"no, {status}"):
            source_of(refusal(status)).claim(CLAIM)


def test_who_asks_too_often_is_told_how_long_to_wait():
    with pytest.raises(UnreachableError) as raised:
        source_of(refusal(429, headers={"Retry-After": "7"})).claim(CLAIM)
    assert raised.value.wait_s == 7.0


def test_nobody_at_the_address_is_worth_another_try():
    with pytest.raises(UnreachableError, match="coordinator: expected one at http://127"):
        HttpSource(Api("http://127.0.0.1:9")).claim(CLAIM)


@pytest.mark.parametrize("url", ["node7:8741", "ftp://node7", "http://", "http://[::1", "file:///etc/passwd"])
def test_an_address_that_is_none_is_refused_at_once(url):
    with pytest.raises(ApiError, match="url: expected one as http://host:8741, got"):
        Api(url)
