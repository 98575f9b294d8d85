import json
import sys

import pytest

from service import cli
from service.cli.report import folder_name
from service.store.store import Store
from tests.service.campaigns import finish, spec_fields, submitted


@pytest.fixture
def coastarc(tmp_path, monkeypatch, capsys):
    """Return a function that runs a command in this process: (exit code, stdout, stderr)."""

    (tmp_path / "archive").mkdir()

    def call(*arguments):
        words = ["coastarc", *map(str, arguments), "--data", str(tmp_path / "archive")]
        monkeypatch.setattr(sys, "argv", words)
        monkeypatch.chdir(tmp_path)
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    return call


@pytest.fixture
def archive(coastarc, tmp_path):
    with Store(tmp_path / "archive") as store:
        submitted(store)
        finish(store)
    return tmp_path / "archive"


def test_a_report_is_written_where_it_says(coastarc, archive, tmp_path):
    code, printed, _ = coastarc("report", 1)
    path = tmp_path / "report-test" / "report.html"
    assert code == 0 and printed == f"Report: {path}\n"
    assert "<h1>test</h1>" in path.read_text(encoding="utf-8")
    assert (path.parent / "parts" / "feasibility.svg").exists()


def test_a_campaign_may_be_named_and_its_tables_be_json(coastarc, archive, tmp_path):
    _, by_name, _ = coastarc("report", "test", "--json")
    _, by_id, _ = coastarc("report", 1, "--json")
    content = json.loads(by_name)
    assert by_name == by_id and not list(tmp_path.glob("report-*"))
    (row,) = content["tables"]["non-conditional"]
    assert (row["strategy"], row["n_solves"], row["published_ratio_percent"]) == ("S(0)", 8, 9.71)


def test_the_report_agrees_with_what_the_archive_counts(coastarc, archive):
    _, printed, _ = coastarc("report", 1, "--json")
    (drawn,), (mapped,) = (json.loads(printed)["tables"][name] for name in ("non-conditional", "conditional"))
    with Store(archive, read_only=True) as store:
        searches = store.campaign(1).searches
    counted = [(one.n_solves, one.n_paper, one.n_strict) for one in searches]
    assert [(row["n_solves"], row["n_paper"], row["n_strict"]) for row in (drawn, mapped)] == counted


def test_of_several_campaigns_of_a_name_the_newest_is_meant(coastarc, tmp_path):
    with Store(tmp_path / "archive") as store:
        submitted(store)
        newest = submitted(store, spec_fields(guesses=4))
    _, printed, _ = coastarc("report", "test", "--json")
    assert json.loads(printed)["id"] == newest


@pytest.mark.parametrize("asked", ["7", "nobody", "9" * 30])
def test_an_unknown_campaign_is_refused(coastarc, archive, tmp_path, asked):
    code, _, error = coastarc("report", asked)
    assert code == 2 and f"campaign {asked}: expected one that exists" in error
    assert not list(tmp_path.glob("report-*"))


def test_a_folder_has_no_character_that_a_file_system_refuses():
    assert folder_name("paper-small") == "report-paper-small"
    assert folder_name("my runs/2: ../x") == "report-my-runs-2-..-x"
