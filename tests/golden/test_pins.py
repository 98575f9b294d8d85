"""Nothing that others rely on changes unawares; `tests.golden.pins` says how to change it on purpose."""

import json
import signal
import subprocess
import sys

import pytest

from service.cli import main
from tests.golden.pins import PINS, stored
from workers.executor import ExecutorLostError


@pytest.mark.parametrize("name", [name for name in PINS if name != "draws"])
def test_what_others_rely_on_is_what_it_was(name):
    found, before = json.loads(json.dumps(PINS[name]())), stored(name)
    changed = {
        key: (before.get(key), found.get(key)) for key in before | found if before.get(key) != found.get(key)
    }
    assert changed == {}


def test_every_random_stream_begins_as_it_did():
    found, before = PINS["draws"](), stored("draws")
    assert found.keys() == before.keys()
    assert found["bits"] == before["bits"] and found["uniform"] == before["uniform"]
    assert found["samples"] == before["samples"] and found["times"] == before["times"]
    for kind in ("steps", "hops", "guesses", "outages"):
        assert found[kind].keys() == before[kind].keys()
        for law, draws in before[kind].items():
            # Nine digits are stored: half a unit of the last one.
            assert found[kind][law] == pytest.approx(draws, rel=1e-8, abs=0.0)


def coastarc(*words):
    program = f"import sys; from service.cli import main; sys.argv = {['coastarc', *words]}; main()"
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True).returncode


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0, ["--version"]),
        (2, ["no-such-command"]),
        (2, ["status", "--no-such-option"]),
        (2, ["db", "check", "--data", "/nowhere/at/all"]),
        (2, ["solutions", "list", "--data", "/nowhere/at/all"]),
        (2, ["run", "/nowhere/at/all.toml"]),
    ],
)
def test_exit_codes_are_what_they_were(code, words):
    assert coastarc(*words) == code


@pytest.mark.parametrize(("code", "end"), [(3, ExecutorLostError("lost")), (130, KeyboardInterrupt())])
def test_a_dispatcher_that_is_cut_short_says_by_its_exit_code_why(monkeypatch, code, end):
    def dispatch(*_):
        raise end

    # The handlers of this process stay those of pytest.
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setattr("service.cli.processes.dispatch", dispatch)
    monkeypatch.setattr(sys, "argv", ["coastarc", "dispatch", "--url", "http://127.0.0.1:9"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == code
