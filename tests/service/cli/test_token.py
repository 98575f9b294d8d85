import json
import stat
import sys

import pytest

from service import cli
from service.coordinator import Coordinator
from service.schemas.identity import Role
from service.store.store import Store


@pytest.fixture
def coastarc(tmp_path, monkeypatch, capsys):
    """Return a function that runs a command in this process: (exit code, stdout, stderr)."""

    def call(*arguments):
        words = ["coastarc", "token", *map(str, arguments), "--data", str(tmp_path / "data")]
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    return call


def test_a_token_is_printed_alone_so_that_scripts_can_take_it(coastarc, tmp_path):
    code, printed, more = coastarc("create", "ada", "--role", "admin")
    assert code == 0 and "Shown this once" in more
    with Store(tmp_path / "data") as store:
        assert store.identities.identify(printed.strip()).role is Role.ADMIN


def test_a_token_goes_into_a_file_that_nobody_else_can_read(coastarc, tmp_path):
    path = tmp_path / "worker.token"
    code, printed, _ = coastarc("create", "node-1", "--role", "worker", "--out", path)
    assert code == 0 and path.read_text().strip() not in printed
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    code, _, complaint = coastarc("create", "node-2", "--out", path)
    assert code == 2 and "expected a file that is not there yet" in complaint


def test_tokens_are_listed_and_revoked_without_their_secrets(coastarc):
    secret = coastarc("create", "ada")[1].strip().split("_", 2)[2]
    assert coastarc("revoke", "ada")[1] == "token ada is revoked\n"
    listed, as_json = coastarc("list")[1], coastarc("list", "--json")[1]
    assert "revoked" in listed and json.loads(as_json)["items"][0]["state"] == "revoked"
    assert secret not in listed + as_json


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("create", "ada", "--days", "0"), "token.days: expected a number greater than 0"),
        (("create", ""), "token.name: "),
        (("revoke", "bob"), "token bob: expected one that exists"),
        (("list", "--url", "http://127.0.0.1:9"), "coordinator: expected one at http://127.0.0.1:9"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_line(coastarc, arguments, complaint):
    coastarc("create", "first")
    code, _, printed = coastarc(*arguments)
    assert code == 2 and complaint in printed


def test_a_running_coordinator_is_asked_and_its_archive_left_alone(coastarc, tmp_path):
    with Coordinator(tmp_path / "data") as coordinator:
        code, _, complaint = coastarc("create", "ada")
        assert code == 2 and "ask that coordinator with --url" in complaint
        assert coastarc("create", "ada", "--url", coordinator.url)[0] == 0
        assert "ada" in coastarc("list", "--url", coordinator.url)[1]
        assert "is revoked" in coastarc("revoke", "ada", "--url", coordinator.url)[1]
        assert [row.method for row in coordinator.store.identities.audit(9).items] == ["DELETE", "POST"]
