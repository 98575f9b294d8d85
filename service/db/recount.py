"""What tallies have to be: counted from the rows, which takes long.

For archives that had none, for `coastarc db check`, and for tests; see `service.store.tallies`.
"""

_COUNTS = (
    "SELECT search_id, 'attempt', attempt.ending, count(*), 0.0 FROM attempt JOIN job ON job.id = job_id "
    "WHERE attempt.ending IS NOT NULL GROUP BY search_id, attempt.ending",
    "SELECT search_id, 'job', 'done', count(*), 0.0 FROM job WHERE state = 'done' GROUP BY search_id",
    "SELECT search_id, 'solve', ending, count(*), sum(cpu_seconds) FROM solve GROUP BY search_id, ending",
    "SELECT search_id, 'status', status, count(*), 0.0 FROM solve GROUP BY search_id, status",
    "SELECT search_id, 'level', 'paper', count(*), 0.0 FROM solve WHERE paper GROUP BY search_id",
    "SELECT search_id, 'level', 'strict', count(*), 0.0 FROM solve WHERE strict GROUP BY search_id",
    *(
        f"SELECT search_id, '{noun}', scope, count(*), 0.0 FROM (SELECT s.search_id, CASE "
        "WHEN NOT EXISTS (SELECT 1 FROM solve o WHERE o.solution_id = s.solution_id AND o.id < s.id) "
        "THEN 'archive' WHEN NOT EXISTS (SELECT 1 FROM solve o JOIN search b ON b.id = o.search_id "
        "WHERE o.solution_id = s.solution_id AND o.id < s.id AND b.campaign_id = a.campaign_id) "
        "THEN 'campaign' ELSE 'search' END AS scope FROM solve s JOIN search a ON a.id = s.search_id "
        f"WHERE s.solution_id IS NOT NULL {more} AND NOT EXISTS (SELECT 1 FROM solve o WHERE "
        "o.solution_id = s.solution_id AND o.id < s.id AND o.search_id = s.search_id)) AS first "
        "GROUP BY search_id, scope"
        for noun, more in (("solution", ""), ("strict", "AND s.strict"))
    ),
)
#: (search_id, noun, name, number, cpu_seconds), each solution counted where a solve found it first.
TALLIES = " UNION ALL ".join(_COUNTS)
#: The totals of searches.
TOTALS = (
    "UPDATE search SET n_planned = (SELECT count(*) FROM job WHERE search_id = search.id), "
    "n_solves = (SELECT count(*) FROM solve WHERE search_id = search.id), "
    "cpu_seconds = (SELECT coalesce(sum(cpu_seconds), 0.0) FROM solve WHERE search_id = search.id)"
)
FILL_TALLIES = f"INSERT INTO tally (search_id, noun, name, number, cpu_seconds) {TALLIES}"


def fill_tallies_of(search_ids: list[int]) -> str:
    """Return the statement that fills the tallies of some searches."""
    wanted = ", ".join(str(int(search_id)) for search_id in search_ids)
    return (
        "INSERT INTO tally (search_id, noun, name, number, cpu_seconds) "
        f"SELECT counted.* FROM ({TALLIES}) AS counted WHERE counted.search_id IN ({wanted})"
    )
