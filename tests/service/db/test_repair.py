"""Poisoned archives: `db check` finds each poison, `db repair` sets it aside, and lists answer again."""

import json
import shutil
import sqlite3
import sys

import pytest
from fastapi.testclient import TestClient

from service import cli
from service.app import create_app
from service.db import postgres as postgres_side
from service.db.backup import backup, restore
from service.integrity.check import check
from service.integrity.repair import repair
from service.schemas.solution import Filter
from service.store.store import Store
from tests.service.archive_format.made import certificate_on
from tests.service.campaigns import finish, spec_fields, submitted
from tests.service.databases import needs_postgres
from tests.service.db.test_migrations import table_contents

API = "/api/v1"
#: A solution that seeds others, a solve with a solution, one without, and the attempt of a solve.
SEED = "(SELECT seed_id FROM job WHERE seed_id IS NOT NULL ORDER BY id LIMIT 1)"
SOLVED = "(SELECT min(id) FROM solve WHERE solution_id IS NOT NULL)"
IN_VAIN = "(SELECT min(id) FROM solve WHERE solution_id IS NULL)"
OF_SOLVED = f"job_id = (SELECT job_id FROM solve WHERE id = {SOLVED})"


def on_solution(change):
    return f"UPDATE solution SET {change} WHERE id = {SEED}"


def on_solve(change, which=SOLVED):
    return f"UPDATE solve SET {change} WHERE id = {which}"


POISONS = {
    "a vector of 13 bytes": on_solution("x = X'00112233445566778899aabbcc'"),
    "a vector that is short": on_solution("x = substr(x, 9)"),
    "a vector of nothing": on_solution("x = X''"),
    "a vector with a NaN": on_solution("x = CAST(X'000000000000f87f' || substr(x, 9) AS BLOB)"),
    "another vector": on_solution("x = CAST(substr(x, 9) || substr(x, 1, 8) AS BLOB)"),
    "defects of 13 bytes": on_solution("defects = X'00112233445566778899aabbcc'"),
    "defects that are few": on_solution("defects = substr(defects, 9)"),
    "defects that are large": on_solution(
        "defects = CAST(X'000000000000f07f' || substr(defects, 9) AS BLOB)"
    ),
    "not even the paper's": on_solution("paper = 0, strict = 0"),
    "an infinite mass": on_solution("objective_kg = 9e999"),
    "another delta-v": on_solution("delta_v_km_s = 0.001"),
    "another propellant": on_solution("propellant_kg = -1e308"),
    "another arrival": on_solution("arrival_epoch = 'soon'"),
    "details that are no JSON": on_solution("verification = '{'"),
    "details that are no table": on_solution("verification = '[]'"),
    "a date that never comes": on_solution("created_at = 9e999"),
    "processor time of 1e308": on_solve("cpu_seconds = 1e308"),
    "infinite processor time": on_solve("cpu_seconds = 9e999", IN_VAIN),
    "negative processor time": on_solve("cpu_seconds = -1.0"),
    "infinite wall time": on_solve("wall_seconds = 9e999"),
    "an infinite violation": on_solve("violation = 9e999", IN_VAIN),
    "iterations without end": on_solve("n_iterations = 9223372036854775807"),
    "a hop beyond the job": on_solve("hop = 77"),
    "another key": on_solve("rng_key = 'x'", IN_VAIN),
    "defects as solved of 5 bytes": on_solve("defects = X'0011223344'"),
    "defects as solved that are many": on_solve("defects = CAST(defects || defects AS BLOB)", IN_VAIN),
    "feasible without a solution": on_solve("ending = 'feasible'", IN_VAIN),
    "infeasible with a solution": on_solve("ending = 'infeasible'"),
    "no move": on_solve("move = NULL"),
    "another final mass": on_solve("final_mass_kg = 1.0"),
    "another search": on_solve("search_id = 2"),
    "no provenance": f"UPDATE attempt SET provenance_hash = NULL WHERE {OF_SOLVED}",
    "an attempt that is not there": on_solve("attempt = 5"),
    "a provenance that is no JSON": "UPDATE provenance SET content = 'nothing'",
    "a provenance of something else": "UPDATE provenance SET content = '{\"a\": 1}'",
    "a certificate that is no JSON": "UPDATE certificate SET content = '{'",
    "a certificate with another verdict": "UPDATE certificate SET is_sound = 1 - is_sound",
    "a certificate of an endless flight": "UPDATE certificate SET cpu_seconds = 9e999",
    "500 solves for one hop": (
        "WITH RECURSIVE n(i) AS (SELECT 100 UNION ALL SELECT i + 1 FROM n WHERE i < 599) "
        "INSERT INTO solve (job_id, search_id, attempt, hop, rng_key, ending, status, is_feasible, paper, "
        "strict, defects, n_iterations, n_evaluations, cpu_seconds, wall_seconds, move, created_at) "
        "SELECT job_id, search_id, attempt, i, rng_key, ending, status, is_feasible, paper, strict, defects, "
        f"n_iterations, n_evaluations, 1.0, 1.0, move, created_at FROM solve, n WHERE solve.id = {IN_VAIN}"
    ),
    "feasible without a solve": (
        "UPDATE job SET ending = 'feasible' WHERE id = (SELECT job_id FROM solve GROUP BY job_id "
        "HAVING max(solution_id) IS NULL LIMIT 1)"
    ),
}


@pytest.fixture(scope="module")
def origin(tmp_path_factory):
    """A finished campaign with a certificate, its archive at rest in one file."""
    folder = tmp_path_factory.mktemp("origin")
    with Store(folder) as store:
        submitted(store, spec_fields(guesses=24))
        finish(store)
        first, *_ = store.certificates.ids(Filter(strict=True))
        store.certificates.add(certificate_on(store, first, 0.0), "here")
    return folder


@pytest.fixture
def folder(origin, tmp_path):
    return shutil.copytree(origin, tmp_path / "data")


@pytest.fixture
def run(monkeypatch, capsys, folder):
    """Run `coastarc db` in this process; return exit code and what it printed."""

    def command(*words):
        monkeypatch.setattr(sys, "argv", ["coastarc", "db", *words, "--data", str(folder)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out + printed.err

    return command


def poison(folder, *statements):
    connection = sqlite3.connect(folder / "coastarc.db")
    for statement in statements:
        before = connection.total_changes
        connection.execute(statement)
        assert connection.total_changes > before
    connection.commit()
    connection.close()


def states(folder):
    return {one.name: one.state for one in check(folder / "coastarc.db")}


def lists_answer(folder):
    """Ask every list that shows solves or solutions, and every solution that is left."""
    with Store(folder) as store, TestClient(create_app(store), base_url="http://127.0.0.1:8741") as client:
        for path in ("/solutions", "/solutions/points", "/campaigns", "/campaigns/1", "/campaigns/1/metrics",
                     "/campaigns/1/history", "/campaigns/1/searches/s0/hops", "/jobs", "/attempts", "/queue",
                     "/seeds?campaign=1&search=s1-0"):  # fmt: skip
            answer = client.get(API + path)
            assert answer.status_code == 200, (path, answer.text)
        items = client.get(f"{API}/solutions", params={"limit": 200}).json()["items"]
        for item in items:
            assert client.get(f"{API}/solutions/{item['id']}").status_code == 200
            assert client.get(f"{API}/solutions/{item['id']}/lineage").status_code == 200
        return len(items)


def test_an_archive_that_is_sound_has_nothing_to_repair(run, folder):
    assert set(states(folder).values()) == {"ok"}
    before = table_contents(folder / "coastarc.db")
    code, said = run("repair", "--apply")
    assert code == 0 and "Set aside: no rows" in said
    assert table_contents(folder / "coastarc.db") == before and lists_answer(folder) > 5
    assert not list(folder.glob("coastarc-set-aside-*"))


@pytest.mark.parametrize("name", POISONS)
def test_every_poison_is_found_and_set_aside_and_lists_answer(run, folder, name):
    poison(folder, POISONS[name])
    assert states(folder)["content"] == "failed"
    before = table_contents(folder / "coastarc.db")
    code, said = run("repair")
    assert code == 0 and "Nothing has changed; repeat with --apply" in said
    assert table_contents(folder / "coastarc.db") == before
    code, said = run("repair", "--apply")
    assert code == 0 and "Set aside: " in said
    assert set(states(folder).values()) == {"ok"}
    lists_answer(folder)
    after = table_contents(folder / "coastarc.db")
    (file,) = folder.glob("coastarc-set-aside-*.ndjson")
    written = [json.loads(line) for line in file.read_text().splitlines()]
    for table in ("solve", "solution", "job", "attempt", "certificate", "provenance", "seed_link"):
        n_written = sum(line["table"] == table for line in written)
        assert len(before[table]) - len(after[table]) <= n_written
    assert len(written) > 0


def test_what_is_set_aside_is_written_bit_by_bit_with_its_reason(run, folder):
    poison(folder, on_solve("cpu_seconds = 9e999", IN_VAIN))
    solves = table_contents(folder / "coastarc.db")["solve"]
    (before,) = [row for row in solves if row["cpu_seconds"] == float("inf")]
    run("repair", "--apply")
    (file,) = folder.glob("coastarc-set-aside-*.ndjson")
    (line,) = [o for o in map(json.loads, file.read_text().splitlines()) if o["table"] == "solve"]
    assert "expected cpu_seconds from 0" in line["why"]
    assert line["row"] == before | {
        "cpu_seconds": {"number": "inf"},
        "defects": {"hex": before["defects"].hex()},
    }


def test_what_a_solution_has_seeded_goes_with_it_and_the_rest_stays(run, folder):
    before = table_contents(folder / "coastarc.db")
    poison(folder, on_solution("verification = '{'"))
    run("repair", "--apply")
    after = table_contents(folder / "coastarc.db")
    gone = {row["id"] for row in before["solution"]} - {row["id"] for row in after["solution"]}
    seeded = {row["solution_id"] for row in before["seed_link"] if row["seed_id"] in gone}
    assert gone and seeded <= gone and len(gone) == 1 + len(seeded)
    kept = [row for row in before["solve"] if row["solution_id"] not in gone]
    assert after["solve"] == kept
    assert {row["seed_id"] for row in after["job"]} & gone == set()


def test_wrong_totals_are_counted_anew(run, folder):
    poison(folder, "UPDATE search SET cpu_seconds = 1e300, n_solves = 99", "UPDATE tally SET number = 7")
    assert states(folder)["totals"] == "failed"
    run("repair", "--apply")
    assert set(states(folder).values()) == {"ok"}


def test_an_archive_in_use_or_with_lost_rows_is_left_alone(run, folder):
    from service.coordinator.lock import FolderLock

    with FolderLock(folder):
        assert "expected to be free" in run("repair", "--apply")[1]
    poison(folder, "DELETE FROM problem WHERE k = 1")
    code, said = run("repair", "--apply")
    assert code == 2 and "expected an intact one, got references" in said


@needs_postgres
@pytest.mark.postgres
def test_postgresql_is_repaired_in_the_same_way(folder, tmp_path, new_database):
    url = new_database()
    backup(folder / "coastarc.db", tmp_path / "b.db")
    restore(tmp_path / "b.db", url)
    engine = postgres_side.writer_engine(url)
    with engine.begin() as connection:
        for statement in (
            on_solution("verification = '{', x = substring(x from 4)"),
            on_solve("cpu_seconds = 1e308", IN_VAIN),
            "UPDATE certificate SET is_sound = NOT is_sound",
        ):
            assert connection.exec_driver_sql(statement).rowcount == 1
    assert {one.name for one in check(url) if one.state == "failed"} == {"content", "totals"}
    aside = repair(url, tmp_path / "aside.ndjson")
    assert aside.counts()["certificate"] == 1 and aside.counts()["solution"] >= 1
    assert {one.state for one in check(url)} == {"ok"}
    with engine.begin() as connection:
        n_left = connection.exec_driver_sql("SELECT count(*) FROM solve").scalar()
    engine.dispose()
    written = [json.loads(line)["table"] for line in (tmp_path / "aside.ndjson").read_text().splitlines()]
    assert n_left + written.count("solve") == len(table_contents(folder / "coastarc.db")["solve"])
