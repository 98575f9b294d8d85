"""`coastarc campaigns`, and the same file over HTTP."""

import json
import sys
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from service import cli
from service import client as people
from service.app import create_app
from service.cli.options import console
from service.coordinator import Coordinator
from service.store.store import Store
from tests.acceptance import known
from tests.service.campaigns import submitted


@pytest.fixture
def coastarc(tmp_path, monkeypatch, capsys):
    """Return a function that runs a command in an empty folder: (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(console, "_width", 200)

    def call(*arguments, data):
        words = [str(word) for word in arguments]
        monkeypatch.setattr(sys, "argv", ["coastarc", *words, "--data", str(data)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    return call


def test_a_campaign_goes_from_one_folder_to_another(coastarc, archive, tmp_path):
    code, printed, _ = coastarc("campaigns", "export", "known solutions", data=archive.folder)
    file = tmp_path / "campaign-known-solutions.zip"
    assert code == 0 and f"File: {file.name}" in printed and file.is_file()
    other = tmp_path / "new" / "folder"
    code, printed, _ = coastarc("campaigns", "import", file, data=other)
    assert code == 0 and "Campaign 1: known solutions imported, with 7 solves and 4 new solutions." in printed
    assert "Campaign 1: nothing new" in coastarc("campaigns", "import", file, data=other)[1]
    told = json.loads(coastarc("campaigns", "import", file, "--json", data=other)[1])
    assert told == {
        "campaign_id": 1,
        "new_campaigns": [],
        "n_solves": 0,
        "n_solutions": 0,
        "n_certificates": 0,
    }
    with Store(other, read_only=True) as store:
        assert store.campaign(1).n_solutions == archive.campaign(1).n_solutions == 4


def test_what_is_refused_is_one_line_and_exit_code_2(coastarc, archive, tmp_path):
    (tmp_path / "text.zip").write_text("no campaign")
    code, _, complaint = coastarc("campaigns", "import", "text.zip", data=tmp_path / "new")
    assert code == 2 and "file text.zip: expected a portable file of a campaign, got" in complaint
    assert len(complaint.splitlines()) == 1
    code, _, complaint = coastarc("campaigns", "export", "never", data=archive.folder)
    assert code == 2 and "campaign never: expected one that exists" in complaint


def test_a_campaign_goes_through_a_coordinator(coastarc, archive, tmp_path):
    coastarc("campaigns", "export", 1, "-o", "local.zip", data=archive.folder)
    with Coordinator(tmp_path / "busy") as coordinator:
        there = ("--url", coordinator.url)
        code, printed, _ = coastarc("campaigns", "import", "local.zip", *there, data=tmp_path / "none")
        assert code == 0 and "Campaign 1: known solutions imported, with 7 solves and 4 new" in printed
        assert "nothing new" in coastarc("campaigns", "import", "local.zip", *there, data=tmp_path)[1]
        code, printed, _ = coastarc(
            "campaigns", "export", "known solutions", "-o", "remote.zip", *there, data=tmp_path
        )
        assert code == 0 and "File: remote.zip" in printed
        assert Path("remote.zip").read_bytes() == Path("local.zip").read_bytes()
        code, _, complaint = coastarc("campaigns", "import", "local.zip", data=tmp_path / "busy")
        assert code == 2 and "import into that coordinator with --url" in " ".join(complaint.split())
    assert not (tmp_path / "none").exists()


def test_what_a_coordinator_refuses_is_one_line_and_leaves_no_file(coastarc, archive, tmp_path, monkeypatch):
    (tmp_path / "text.zip").write_text("no campaign")
    with Coordinator(tmp_path / "busy") as coordinator:
        known.submitted(coordinator.store)
        words = {
            ("import", "text.zip"): "file that was sent: expected a portable file of a campaign, got",
            ("import", "none.zip"): "file none.zip: expected a file to send, got No such file",
            ("import", "busy"): "file busy: expected a file to send, got Is a directory",
            ("export", "1"): "campaign 1 (known solutions): expected state paused, done or cancelled, got",
            ("export", "7"): "campaign 7: expected one that exists",
        }
        for command, expected in words.items():
            code, _, complaint = coastarc("campaigns", *command, "--url", coordinator.url, data=tmp_path)
            assert code == 2 and complaint.startswith(f"error: {expected}"), complaint
            assert len(complaint.splitlines()) == 1
        monkeypatch.setattr(people, "MAX_PORTABLE_BYTES", 5)
        complaint = coastarc("campaigns", "import", "text.zip", "--url", coordinator.url, data=tmp_path)[2]
        assert "file text.zip: expected at most 5 bytes, got 11; stop the coordinator" in complaint
    assert sorted(path.name for path in tmp_path.iterdir()) == ["busy", "text.zip"]


def test_http_gives_the_same_file_and_refuses_a_campaign_at_work(coastarc, archive):
    with TestClient(create_app(archive), base_url="http://127.0.0.1:8741") as asked:
        answer = asked.get("/api/v1/campaigns/1/export")
        coastarc("campaigns", "export", 1, "-o", "same.zip", data=archive.folder)
        assert answer.headers["content-type"] == "application/zip"
        assert 'filename="campaign-known-solutions.zip"' in answer.headers["content-disposition"]
        assert answer.content == Path("same.zip").read_bytes()
        busy = asked.get(f"/api/v1/campaigns/{submitted(archive)}/export")
        assert busy.status_code == 409 and "or pause it" in busy.json()["detail"]
        assert asked.get("/api/v1/campaigns/99/export").status_code == 404
