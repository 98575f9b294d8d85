"""What came of a solution, and what it looks like as a file and as a problem."""

import csv
import sqlite3

import numpy as np
import pytest
from sqlalchemy.dialects import sqlite

from core.problem import load_problem, problem_from
from service.dashboard import structure
from service.dashboard.structure import structure_of
from service.schemas.solution import Filter
from service.store import lineage
from tests.acceptance import known
from tests.service.campaigns import finish, spec_fields, submitted
from tests.service.databases import needs_postgres

API = "/api/v1"
#: A statement with its values in it.
LITERAL = {"literal_binds": True}


@pytest.fixture
def finished(store):
    fields = spec_fields(guesses=12)
    fields["search"][1]["mapping"] = ["reference", "continued"]
    submitted(store, fields)
    finish(store)
    return store


def test_a_seed_knows_what_became_of_its_guesses(client, finished):
    children = finished.all_records(Filter(search="s1-0"))
    seed = children[0].seed_id
    answer = client.get(f"{API}/solutions/{seed}/lineage").json()
    own = [record for record in children if record.seed_id == seed]
    assert {child["id"] for child in answer["children"]} == {record.id for record in own}
    assert answer["n_children"] == len(own) and answer["n_mapped"] >= len(own)
    assert {child["mapping"] for child in answer["children"]} == {record.mapping for record in own}
    assert answer["command"] == f"coastarc solutions reproduce {seed}"


@pytest.mark.parametrize(
    "store",
    ["sqlite", pytest.param("postgresql", marks=[pytest.mark.postgres, needs_postgres])],
    indirect=True,
)
def test_of_many_children_the_best_are_listed_and_all_are_counted(client, finished):
    seed = finished.all_records(Filter(search="s1-0"))[0].seed_id
    every = client.get(f"{API}/solutions/{seed}/lineage").json()
    first = client.get(f"{API}/solutions/{seed}/lineage", params={"children": 1}).json()
    assert first["children"] == every["children"][:1] and first["n_children"] == every["n_children"] > 1


def test_a_solution_that_seeded_nothing_has_no_children(client, finished):
    last = finished.all_records(Filter(search="s1-0"))[0].id
    answer = client.get(f"{API}/solutions/{last}/lineage").json()
    assert (answer["children"], answer["n_children"], answer["n_mapped"]) == ([], 0, 0)
    assert len(answer["nodes"]) == 2 and len(answer["edges"]) == 1


def test_children_are_found_by_the_whole_address_of_their_jobs(finished):
    values = {"searches": [2], "cases": [0], "seed": 32 * "0"}
    text = str(lineage._CHILDREN.params(**values).compile(dialect=sqlite.dialect(), compile_kwargs=LITERAL))
    archive = sqlite3.connect(finished.folder / "coastarc.db")
    plan = [row[3] for row in archive.execute(f"EXPLAIN QUERY PLAN {text}")]
    archive.close()
    (jobs,) = [line for line in plan if line.startswith("SEARCH job ")]
    assert "(search_id=? AND kind=? AND case_index=? AND chain=?)" in jobs
    assert not [line for line in plan if line.startswith("SCAN")], plan


def table(text):
    head = [line for line in text.splitlines() if line.startswith("#")]
    return head, list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def test_states_and_controls_come_with_epoch_frame_and_units(asked, archive):
    record = archive.all_records(Filter(search="s1-0"))[0]
    answer = asked.get(f"{API}/solutions/{record.id}/export", params={"format": "csv"})
    assert answer.headers["content-type"].startswith("text/csv")
    assert f'filename="coastarc-{record.id[:8]}-all.csv"' in answer.headers["content-disposition"]
    head, rows = table(answer.text)
    assert record.id in head[0] and "J2000" in head[2] and "km/s" in head[3] and "TDB" in head[3]
    departure = problem_from(archive.problem(record.problem_hash).definition).departure
    assert rows[0]["epoch_tdb"][:19] == departure.epoch
    place = [float(rows[0][name]) for name in ("x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s")]
    # The first sample is the departure, through canonical units and back.
    assert place == pytest.approx([*departure.position_km, *departure.velocity_km_s], rel=1e-12)
    assert {row["trajectory"] for row in rows} == {"reference", "realization 1"}
    own = [row for row in rows if row["trajectory"] == "reference"]
    assert own[-1]["epoch_tdb"][:16] == record.arrival_epoch[:16]
    outage = [row for row in rows if row["arc"] == "outage"]
    assert {(row["outage_segment"], row["throttle"]) for row in outage} == {("24", "0.0")}


def test_a_vector_comes_with_names_and_bounds(asked, archive):
    record = archive.all_records(Filter(search="s1-0"))[0]
    answer = asked.get(f"{API}/solutions/{record.id}/export", params={"what": "vector"})
    _, rows = table(answer.text)
    assert [float(row["value"]) for row in rows] == record.x
    assert (rows[0]["variable"], rows[0]["unit"], float(rows[0]["value"])) == (
        "shooting_time",
        "d",
        record.shooting_days,
    )
    assert all(float(row["lower"]) <= float(row["value"]) <= float(row["upper"]) for row in rows)
    assert sum(row["variable"] == "final_mass" for row in rows) == 2


def test_a_problem_tells_its_best_solutions_and_its_relatives(asked, archive):
    reference = archive.all_records(Filter(search="s0"))
    robust = archive.all_records(Filter(search="s1-0"))
    answer = asked.get(f"{API}/problems/{reference[0].problem_hash}/family").json()
    assert [row["id"] for row in answer["best"]] == [record.id for record in reference]
    assert answer["n_solutions"] == len(reference) and answer["n_fewer"] == 0
    assert answer["more"][0]["hash"] == robust[0].problem_hash and answer["more"][0]["outage"] == known.OUTAGE
    assert answer["more"][0]["best_delta_v_km_s"] == robust[0].delta_v_km_s
    back = asked.get(f"{API}/problems/{robust[0].problem_hash}/family").json()
    assert [row["hash"] for row in back["fewer"]] == [reference[0].problem_hash] and back["more"] == []


def test_the_structure_of_a_problem_has_the_sizes_of_the_method(asked, archive):
    record = archive.all_records(Filter(search="s1-0"))[0]
    answer = asked.get(f"{API}/problems/{record.problem_hash}/structure")
    found = answer.json()
    assert found["n_variables"] == len(record.x) and found["n_defects"] == 14
    assert sum(length for _, _, length in found["runs"]) == found["n_nonzeros"]
    assert found["departure_epoch"][:19] == "2026-04-26T14:47:58"
    # docs/method.md, section 13: P_0 of 98 days is .618; here interpolated from neighbours of 90 and 100.
    none = {chance["arc_days"]: chance["none"] for chance in found["chances"]}
    assert none[90.0] > 0.618 > none[100.0]
    assert "max-age" in answer.headers["cache-control"]


def test_twelve_outages_are_pictured_and_large_pictures_are_filled(monkeypatch):
    problem = load_problem("ppe-drm3").with_outages([(n, 1.0) for n in range(2, 50, 4)])
    found = structure_of(problem)
    assert len(found.trajectories) == 13 and len(found.runs) < structure.MOST_RUNS and found.filled_gap == 0
    assert found.trajectories[-1].leaves == "backward" and found.trajectories[1].leaves == "forward"
    monkeypatch.setattr(structure, "MOST_RUNS", 200)
    filled = structure_of(problem)
    assert len(filled.runs) <= 200 and filled.filled_gap > 0
    covered = np.zeros((found.n_defects, found.n_variables), dtype=bool)
    for row, first, length in filled.runs:
        covered[row, first : first + length] = True
    assert all(covered[row, first : first + length].all() for row, first, length in found.runs)


def test_an_unknown_problem_is_not_found(client):
    for part in ("structure", "family"):
        assert client.get(f"{API}/problems/{32 * '0'}/{part}").status_code == 404
