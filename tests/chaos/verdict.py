"""Whether an archive is what it would be if nothing had happened, bit for bit."""

import sqlite3
from collections.abc import Iterable
from contextlib import closing
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

from service.db.engine import place_of
from service.integrity.check import check
from service.spec import spec_from
from service.store.store import Store
from tests.service.campaigns import content, finish

#: Columns that may differ between two runs: row numbers, times, and who did it at which attempt.
VOLATILE = {
    "campaign": {"id", "created_at", "finished_at"},
    "search": {"id", "campaign_id", "source_id", "served_s"},
    "job": {"id", "search_id", "attempt", "n_failures", "not_before", "worker", "created_at", "updated_at"},
    "solve": {"id", "job_id", "search_id", "attempt", "created_at"},
    "solution": {"created_at"},
    "seed_link": set(),
    "search_case": {"search_id"},
    "problem": set(),
}
#: What stands for the row numbers: the place of a row in its campaign.
SEARCH_PLACE = "(SELECT c.spec_hash || ' ' || s.name FROM search s JOIN campaign c ON c.id = s.campaign_id"
PLACES = {
    "search": f"{SEARCH_PLACE} WHERE s.id = t.id)",
    "job": f"{SEARCH_PLACE} WHERE s.id = t.search_id)",
    "search_case": f"{SEARCH_PLACE} WHERE s.id = t.search_id)",
    "solve": f"{SEARCH_PLACE} WHERE s.id = t.search_id)"
    " || (SELECT kind || case_index || ' ' || chain || ' ' || hop FROM job WHERE id = t.job_id)",
}
#: Questions whose answer must be no row, with what a row would mean.
NEVER = {
    "a job is not done": "SELECT id, state FROM job WHERE state != 'done'",
    "a job has not exactly one accepted outcome": "SELECT job.id, count(attempt.job_id) FROM job"
    " LEFT JOIN attempt ON attempt.job_id = job.id AND next_state = 'done'"
    " GROUP BY job.id HAVING count(attempt.job_id) != 1",
    "a hop was stored twice": "SELECT job_id, hop FROM solve GROUP BY job_id, hop HAVING count(*) > 1",
    "solves are not of the accepted attempt, or of those that handed in hops before": "SELECT solve.job_id"
    " FROM solve JOIN attempt ON attempt.job_id = solve.job_id AND next_state = 'done'"
    " WHERE solve.attempt > attempt.attempt"
    " UNION ALL SELECT early.job_id FROM solve early JOIN solve late ON late.job_id = early.job_id"
    " AND late.hop > early.hop AND late.attempt < early.attempt",
    "solves of a job are missing": "SELECT job.id, n_hops, count(solve.id) FROM job"
    " LEFT JOIN solve ON solve.job_id = job.id GROUP BY job.id HAVING count(solve.id) != n_hops",
    "an attempt is still open": "SELECT job_id, attempt FROM attempt WHERE ended_at IS NULL",
    "a campaign or search is open": "SELECT name, state FROM campaign WHERE state != 'done'"
    " UNION ALL SELECT name, state FROM search WHERE state != 'done'",
}


def undisturbed(folder: Path, campaigns: Iterable[dict[str, Any]]) -> None:
    """Run the same campaigns in one process, where nobody is killed."""
    folder.mkdir(parents=True)
    with Store(folder) as store:
        for fields in campaigns:
            store.submit(spec_from(fields))
        finish(store)


def faults_of(archive: Path, expected: Path, seen_done: dict[int, int]) -> list[str]:
    """Return all that is wrong with an archive, in words."""
    with closing(opened(archive)) as rows, closing(opened(expected)) as others:
        faults = [
            f"{what}: {found[:3]}"
            for what, query in NEVER.items()
            if (found := rows.execute(query).fetchall())
        ]
        faults += _lost(rows, seen_done)
        faults += _circles(rows)
        for table in VOLATILE:
            faults += _differences(table, bits(rows, table), bits(others, table))
    with Store(archive, read_only=True) as store, Store(expected, read_only=True) as other:
        if content(store) != content(other):
            faults.append("solutions: expected those of an undisturbed run, got others")
    checks = check(place_of(archive))
    return faults + [f"db check {entry.name}: {entry.found}" for entry in checks if entry.state == "failed"]


def opened(archive: Path) -> sqlite3.Connection:
    """Return a connection that reads an archive, which may be in use."""
    return sqlite3.connect(f"file:{archive / 'coastarc.db'}?mode=ro", uri=True)


def bits(rows: sqlite3.Connection, table: str) -> list[str]:
    """Return the rows of a table without what may differ, sorted; numbers and blobs in full."""
    names = [row[1] for row in rows.execute(f"PRAGMA table_info({table})")]
    kept = ", ".join(f"t.{name}" for name in names if name not in VOLATILE[table])
    place = PLACES.get(table, "''")
    return sorted(map(repr, rows.execute(f"SELECT {place}, {kept} FROM {table} t")))


def _differences(table: str, found: list[str], expected: list[str]) -> list[str]:
    if found == expected:
        return []
    more, missing = set(found) - set(expected), set(expected) - set(found)
    example = next(iter(sorted(more | missing)))[:300]
    return [
        f"{table}: expected the {len(expected)} rows of an undisturbed run, got {len(found)}, of which "
        f"{len(more)} are others and {len(missing)} are missing, as {example}"
    ]


def _lost(rows: sqlite3.Connection, seen_done: dict[int, int]) -> list[str]:
    """Compare with what was told over the API while the service was under fire."""
    now = dict(rows.execute("SELECT id, attempt FROM job WHERE state = 'done'"))
    changed = [job for job, attempt in seen_done.items() if now.get(job) != attempt]
    return [f"jobs {changed[:3]}: expected to stay done by the same attempt"] if changed else []


def _circles(rows: sqlite3.Connection) -> list[str]:
    graph: dict[str, set[str]] = {}
    for solution, seed in rows.execute("SELECT solution_id, seed_id FROM seed_link"):
        graph.setdefault(solution, set()).add(seed)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return [f"lineage: expected no circle, got {error.args[1]}"]
    return []
