import io
import json
import logging
import os
import subprocess
import sys
import threading

import pytest

from service import logs
from service.schemas.identity import Role
from service.store.identity import new_secret, split_token
from workers import logs as log_lines
from workers.dispatch import DispatchOrder

FAKE = "tests.workers.fake:run_fake"

log = logging.getLogger("service.test")


@pytest.fixture
def lines():
    root = logging.getLogger()
    before = root.handlers[:], root.level
    stream = io.StringIO()
    logs.configure(stream)
    yield lambda: [json.loads(line) for line in stream.getvalue().splitlines()]
    root.handlers[:], root.level = before


def test_a_line_is_one_object_with_the_ids_of_what_it_is_about(lines):
    with logs.about(worker="node7:1"):
        log.info("attempt\nended", extra={"campaign": 1, "job": 17, "attempt": 2})
    log.info("alone")
    first, second = lines()
    assert first["message"] == "attempt\nended" and first["level"] == "info"
    assert [first[name] for name in logs.IDS] == [1, 17, 2, "node7:1"]
    assert set(second) == {"time", "level", "logger", "message"} and second["time"].endswith("+00:00")


def test_a_dispatcher_writes_such_lines_too_with_its_name_and_without_its_token():
    token = new_secret().written()
    order = DispatchOrder(
        url="http://127.0.0.1:9", token=token, executor="inline", runner=FAKE, prefix="local:"
    )
    child = subprocess.Popen(
        [sys.executable, "-P", "-m", "workers.dispatch"],
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=dict(os.environ) | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    child.stdin.write(f"{order.written()}\n")
    child.stdin.flush()
    first = child.stderr.readline()
    _, rest = child.communicate("stop\n", timeout=60)
    line = json.loads(first)
    assert line["worker"].startswith("local:") and "expected one at http://127.0.0.1:9" in line["message"]
    assert child.returncode == 0 and split_token(token).secret not in first + rest
    assert all(json.loads(line)["worker"] for line in rest.splitlines())


def test_a_signature_is_on_every_line_of_a_process_whatever_its_thread(lines, monkeypatch):
    monkeypatch.setattr(log_lines, "_signature", {})
    log_lines.sign(worker="node7:1", job=None)
    thread = threading.Thread(target=lambda: log.info("elsewhere"))
    thread.start()
    thread.join()
    assert lines()[0]["worker"] == "node7:1" and "job" not in lines()[0]


def test_ids_belong_to_their_own_thread(lines):
    with logs.about(job=1):
        thread = threading.Thread(target=lambda: log.info("elsewhere"))
        thread.start()
        thread.join()
    assert "job" not in lines()[0]


def test_a_traceback_stays_in_its_line(lines):
    try:
        raise ZeroDivisionError("oh")
    except ZeroDivisionError:
        log.exception("failed")
    (line,) = lines()
    assert line["level"] == "error" and line["traceback"].endswith("ZeroDivisionError: oh")


def test_secrets_are_blotted_out(lines, store):
    token = store.identities.create("ada", Role.ADMIN, 1.0).token
    log.warning("got %s and postgresql://ada:secret@db/archive", token)
    message = lines()[0]["message"]
    assert "secret" not in message and token not in message and "@db/archive" in message


def test_what_a_transaction_says_is_logged_once_it_is_stored_and_never_otherwise(lines, store):
    def work(fails):
        def inner(session):
            logs.say(session, log, logging.INFO, "stored", job=3)
            if fails:
                raise ZeroDivisionError

        return inner

    with pytest.raises(ZeroDivisionError):
        store._database.write(work(True))
    assert lines() == []
    store._database.write(work(False))
    store.check()
    assert [(line["message"], line["job"]) for line in lines()] == [("stored", 3)]


@pytest.fixture
def folding():
    """A handler whose clock is set by hand, the logger that it serves, and what it has written."""
    stream, now = io.StringIO(), [0.0]
    handler = log_lines.FoldingHandler(stream, lambda: now[0])
    handler.setFormatter(log_lines.JsonLines())
    logger = logging.getLogger("service.folding")
    logger.propagate, logger.handlers[:] = False, [handler]
    yield handler, logger, now, lambda: [json.loads(line) for line in stream.getvalue().splitlines()]
    logger.handlers.clear()


def test_a_repeated_fault_is_one_line_a_minute_with_its_number(folding):
    _, logger, now, written = folding
    for _ in range(10_000):
        logger.error("no file left: %s", "socket")
    assert [line["message"] for line in written()] == ["no file left: socket"]
    now[0] = 61.0
    logger.error("no file left: %s", "socket")
    assert [line["message"] for line in written()[1:]] == [
        "9999 more within 60 s like: no file left: socket",
        "no file left: socket",
    ]


def test_faults_of_one_place_that_name_different_jobs_are_folded_from_the_twentieth_on(folding):
    handler, logger, _, written = folding
    for job in range(1000):
        logger.warning("job %d failed", job, extra={"job": job})
    logger.warning("another fault")
    assert [line["message"] for line in written()] == [f"job {n} failed" for n in range(20)] + [
        "another fault"
    ]
    handler.close()
    assert written()[-1]["message"] == "980 more within 60 s like: job 0 failed"


def test_what_is_no_fault_is_never_folded_and_faults_of_different_causes_are_told_apart(folding):
    _, logger, _, written = folding
    logger.setLevel(logging.INFO)
    for cause in (KeyError("a"), KeyError("b"), KeyError("b")):
        logger.info("claimed")
        logger.error("failed", exc_info=cause)
    assert [line["message"] for line in written()] == ["claimed", "failed", "claimed", "failed", "claimed"]
