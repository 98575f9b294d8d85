"""`coastarc campaigns`, and the same file over HTTP."""

import json
import sys
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from service import cli
from service.app import create_app
from service.store import Store
from tests.acceptance import known
from tests.service.campaigns import submitted


@pytest.fixture
def coastarc(tmp_path, monkeypatch, capsys):
    """Return a function that runs a command in an empty folder: (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli.console, "_width", 200)

    def call(*arguments, data):
        words = [str(word) for word in arguments]
        monkeypatch.setattr(sys, "argv", ["coastarc", *words, "--data", str(data)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    return call


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    with Store(tmp_path_factory.mktemp("archive")) as store:
        known.submitted(store)
        work = known.dispatcher(store)
        while any(item.state == "active" for item in store.campaigns()):
            work.step()
        yield store


def test_a_campaign_goes_from_one_folder_to_another(coastarc, archive, tmp_path):
    code, printed, _ = coastarc("campaigns", "export", "known solutions", data=archive.folder)
    file = tmp_path / "campaign-known-solutions.zip"
    assert code == 0 and f"File: {file.name}" in printed and file.is_file()
    other = tmp_path / "new" / "folder"
    code, printed, _ = coastarc("campaigns", "import", file, data=other)
    assert code == 0 and "Campaign 1: known solutions taken in, with 7 solves and 4 new solutions." in printed
    assert "Campaign 1: nothing is new" in coastarc("campaigns", "import", file, data=other)[1]
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


def test_http_gives_the_same_file_and_refuses_a_campaign_at_work(coastarc, archive):
    with TestClient(create_app(archive), base_url="http://127.0.0.1:8741") as asked:
        answer = asked.get("/api/v1/campaigns/1/export")
        coastarc("campaigns", "export", 1, "-o", "same.zip", data=archive.folder)
        assert answer.headers["content-type"] == "application/zip"
        assert 'filename="campaign-known-solutions.zip"' in answer.headers["content-disposition"]
        assert answer.content == Path("same.zip").read_bytes()
        busy = asked.get(f"/api/v1/campaigns/{submitted(archive)}/export")
        assert busy.status_code == 409 and "pause it with `coastarc pause" in busy.json()["detail"]
        assert asked.get("/api/v1/campaigns/99/export").status_code == 404
