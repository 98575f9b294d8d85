import json
import re

import pytest

from core.plain_data import NAMES_OF_PLANETS
from core.problem import load_problem
from service.api import metrics
from tests.service.campaigns import OUTAGE, SPIRAL, finish, spec_fields, submitted

API = "/api/v1"


@pytest.fixture
def finished(store):
    submitted(store)
    finish(store)
    return store


def test_submitting_stores_a_campaign_and_says_where_it_is(client, store):
    answer = client.post(f"{API}/campaigns", json=spec_fields())
    assert answer.status_code == 201 and answer.headers["location"] == f"{API}/campaigns/1"
    body = answer.json()
    assert body["name"] == "test" and [s["state"] for s in body["searches"]] == ["active", "waiting"]
    assert store.campaign(1).searches[0].jobs.queued == 4


def test_submitting_again_answers_200_with_the_same_campaign(client):
    client.post(f"{API}/campaigns", json=spec_fields())
    answer = client.post(f"{API}/campaigns", json=spec_fields())
    assert answer.status_code == 200 and answer.json()["id"] == 1


def test_a_departure_that_cannot_be_is_refused_and_not_stored(client, store):
    problem = {"preset": "ppe-drm3", "spacecraft": {"dry_mass_kg": 14999.0}, "departure": SPIRAL}
    answer = client.post(f"{API}/campaigns", json=spec_fields(problem=problem))
    assert answer.status_code == 422 and answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["detail"].startswith("spec.problem: spiral: expected 9.0 days of thrust before")
    assert store.campaigns() == []


def test_a_finished_campaign_shows_counts_and_the_best(client, finished):
    body = client.get(f"{API}/campaigns/1").json()
    s0, s1 = body["searches"]
    assert body["state"] == "done" and body["eta_seconds"] == 0.0
    assert s0["hops"] == 2 and s1["hops"] == 1
    assert set(s0["statuses"]) == {"OPTIMAL", "STALLED"} and sum(s0["statuses"].values()) == 8
    assert s0["n_solves"] == 8 and s0["n_strict"] <= s0["n_paper"] <= s0["n_solves"]
    assert s0["strict_ratio"]["value"] == s0["n_strict"] / 8
    assert 0 < s0["strict_ratio"]["low"] < s0["strict_ratio"]["value"] <= s0["strict_ratio"]["high"] <= 1
    (case,) = s1["cases"]
    assert case["outages"] == [{"segment": 24, "duration_days": 1.0}] and s1["mapping"] == "reference"
    assert body["best_delta_v_km_s"] == min(s["best_delta_v_km_s"] for s in body["searches"])
    assert client.get(f"{API}/campaigns").json()["items"][0]["n_solves"] == body["n_solves"]


def test_pages_of_solutions_join_to_the_whole_in_order(client, finished):
    found, after = [], None
    while True:
        parameters = {"limit": 2} | ({"after": after} if after else {})
        page = client.get(f"{API}/solutions", params=parameters).json()
        found += page["items"]
        if (after := page["next"]) is None:
            break
    masses = [record["objective_kg"] for record in found]
    assert masses == sorted(masses, reverse=True)
    assert len({record["id"] for record in found}) == len(found) == finished.campaign(1).n_solutions


def test_filters_restrict(client, finished):
    def n(**parameters):
        return len(client.get(f"{API}/solutions", params=parameters).json()["items"])

    assert n(search="s0") + n(search="s1-0") == n() == n(campaign=1)
    assert n(strict=True) + n(strict=False) == n() and n(campaign=2) == 0


def test_a_record_has_every_field_that_the_archive_promises(client, finished):
    listed = client.get(f"{API}/solutions", params={"search": "s1-0"}).json()["items"][0]
    record = client.get(f"{API}/solutions/{listed['id']}").json()
    assert {name: record[name] for name in listed} == listed
    assert len(record["x"]) == 154 + 3 * 26 + 4 and all(isinstance(value, float) for value in record["x"])
    assert len(record["defects_verified"]) == len(record["defects_solved"]) == 2
    assert record["seed_id"] and record["rng_key"].startswith("7/1/1/0/")
    assert record["package_versions"] and record["kernel_hashes"] and record["host"]


def test_a_lineage_leads_to_the_seed(client, finished):
    child = client.get(f"{API}/solutions", params={"search": "s1-0"}).json()["items"][0]
    body = client.get(f"{API}/solutions/{child['id']}/lineage").json()
    assert [node["id"] for node in body["nodes"]] == [child["id"], child["seed_id"]]
    assert body["edges"] == [
        {"seed_id": child["seed_id"], "solution_id": child["id"], "mapping": "reference"}
    ]


def test_a_problem_is_checked_and_stored_under_its_hash_once(client, store):
    fields = {"preset": "ppe-drm3", "outages": [OUTAGE]}
    answer = client.post(f"{API}/problems", json=fields)
    view = answer.json()
    assert answer.status_code == 201 and answer.headers["location"] == f"{API}/problems/{view['hash']}"
    assert (view["k"], view["outages"]) == (1, [OUTAGE]) and view == store.problem(view["hash"]).model_dump()
    assert client.post(f"{API}/problems", json=fields).status_code == 200
    assert [item.hash for item in store.problems().items] == [view["hash"]]
    assert client.get(f"{API}/seeds", params={"problem": view["hash"]}).json()["items"] == []


@pytest.mark.parametrize(
    ("fields", "detail"),
    [
        ({}, "problem.spacecraft: expected a value"),
        ({"preset": "none"}, "problem.preset: expected one of"),
        (
            {"preset": "ppe-drm3", "target": {"kind": "spk", "path": "/etc/passwd"}},
            "problem.target: expected a target without a file",
        ),
        (
            {"preset": "ppe-drm3", "spacecraft": {"dry_mass_kg": 14999.0}, "departure": SPIRAL},
            "problem: spiral: expected 9.0 days",
        ),
    ],
)
def test_a_problem_that_cannot_be_is_refused_and_not_stored(client, store, fields, detail):
    answer = client.post(f"{API}/problems", json=fields)
    assert answer.status_code == 422 and answer.json()["detail"].startswith(detail)
    assert store.problems().items == []


def test_problems_and_jobs_are_listed(client, finished):
    problems = client.get(f"{API}/problems").json()["items"]
    assert [problem["k"] for problem in problems] == [0, 1]
    view = client.get(f"{API}/problems/{problems[1]['hash']}").json()
    assert view["definition"]["outages"] == [{"segment": 24, "duration_days": 1.0}]
    jobs = client.get(f"{API}/jobs", params={"search": "s0", "limit": 3}).json()
    assert [job["kind"] for job in jobs["items"]] == ["hop"] * 3
    rest = client.get(f"{API}/jobs", params={"search": "s0", "after": jobs["next"]}).json()
    assert len(rest["items"]) == 1 and rest["next"] is None


def test_events_are_numbered_and_can_be_resumed(client, finished):
    everything = client.get(f"{API}/events", params={"campaign": 1}).json()["items"]
    ids = [event["id"] for event in everything]
    assert ids == sorted(set(ids)) and everything[-1]["data"] == {"state": "done"}
    assert {event["kind"] for event in everything} == {"job", "solution", "search", "campaign"}
    later = client.get(f"{API}/events", params={"after": ids[4]}).json()["items"]
    assert later == everything[5:]


def test_a_stream_carries_the_same_events_and_resumes_after_the_last_id(client, finished):
    client.app.state.is_closing = OnceOpen()
    headers = {"Last-Event-ID": "3"}
    answer = client.get(f"{API}/campaigns/1/events", headers=headers)
    assert answer.headers["content-type"].startswith("text/event-stream")
    events = [json.loads(line[6:]) for line in answer.text.splitlines() if line.startswith("data: ")]
    assert events == client.get(f"{API}/events", params={"after": 3, "campaign": 1}).json()["items"]
    assert "id: 4" in answer.text.splitlines()


def test_a_stream_without_a_place_begins_with_the_latest_event(client, finished):
    client.app.state.is_closing = OnceOpen()
    answer = client.get(f"{API}/campaigns/1/events")
    events = [json.loads(line[6:]) for line in answer.text.splitlines() if line.startswith("data: ")]
    assert [event["data"] for event in events] == [{"state": "done"}]


class OnceOpen:
    """Lets a stream look for events once, then ends it."""

    def __init__(self):
        self.n_calls = 0

    def __call__(self):
        self.n_calls += 1
        return self.n_calls > 1


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/campaigns/99", 404),
        ("/campaigns/99/events", 404),
        ("/campaigns/nine", 422),
        ("/campaigns/99999999999999999999", 422),
        (f"/solutions/{'0' * 32}", 404),
        (f"/solutions/{'0' * 32}/lineage", 404),
        (f"/solutions/{'0' * 32}/trajectory", 404),
        ("/solutions/..%2f..%2fetc", 404),
        ("/solutions/xyz", 422),
        ("/solutions?limit=1000", 422),
        ("/solutions?after=nonsense", 422),
        (f"/problems/{'0' * 32}", 404),
        ("/jobs?state=asleep", 422),
        ("/nothing", 404),
    ],
)
def test_a_wrong_request_is_refused_as_a_problem(client, path, status):
    answer = client.get(API + path)
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["status"] == status and answer.json()["detail"]


@pytest.mark.parametrize(
    ("method", "path", "detail"),
    [
        ("GET", "/nothing", "path: expected one of this service, got /api/v1/nothing; "),
        ("DELETE", "/jobs", "method: expected one that /api/v1/jobs has, got DELETE"),
        ("GET", "/solutions?limit=1000", "request.query.limit: expected a number of at most 200, got '1000'"),
        ("GET", "/campaigns/nine", "request.path.campaign_id: expected an integer, got 'nine'"),
    ],
)
def test_a_refusal_names_what_was_expected_and_what_came(client, method, path, detail):
    assert client.request(method, API + path).json()["detail"].startswith(detail)


@pytest.mark.parametrize(
    "body", [b"", b"{", b"[]", b"7", b'{"campaign": 1}', json.dumps(spec_fields(guesses=0)).encode()]
)
def test_a_wrong_specification_is_refused_as_a_problem(client, body, store):
    answer = client.post(f"{API}/campaigns", content=body, headers={"content-type": "application/json"})
    assert answer.status_code == 422 and answer.headers["content-type"] == "application/problem+json"
    assert store.campaigns() == []


def test_numbers_that_are_not_finite_are_refused(client, store):
    body = json.dumps(spec_fields()).replace('"guesses": 8', '"core_seconds": NaN')
    answer = client.post(f"{API}/campaigns", content=body, headers={"content-type": "application/json"})
    assert answer.status_code == 422 and store.campaigns() == []


@pytest.mark.parametrize(
    "problem",
    [
        {"preset": "ppe-drm3", "target": {"kind": "spk", "path": "/etc/passwd", "naif_id": -7}},
        {"preset": "earth-mars", "world": {"bodies": ["VENUS"], "kernel": "/etc/passwd"}},
        {"preset": "earth-mars", "target": {"path": ["de440.bsp"]}},
    ],
)
def test_no_path_from_a_client_is_opened(client, problem):
    answer = client.post(f"{API}/campaigns", json=spec_fields(problem=problem))
    assert answer.status_code == 422 and "without a file" in answer.json()["detail"]


@pytest.mark.parametrize("path", NAMES_OF_PLANETS)
def test_a_planet_may_be_the_target_over_the_network(client, path):
    fields = load_problem("earth-mars").model_dump(mode="json")
    fields["target"]["path"] = path
    assert client.post(f"{API}/campaigns", json=spec_fields(problem=fields)).status_code == 201


@pytest.mark.parametrize(
    ("changes", "detail"),
    [
        ({"world": {"bodies": ["MARS"]}}, "spec.problem.world: bodies: .*, got MARS; did you mean MARS BARY"),
        ({"world": {"bodies": "VENUS"}}, "spec.problem.world.bodies: expected a list, got 'VENUS'"),
        ({"world": {"center": "EARTH"}}, 'spec.problem.departure.position_km: .* mean center = "SUN"[?]'),
        (
            {"world": {"bodies": ["MARS BARYCENTER"]}},
            "spec.problem.target.naif_id: .*, got 4, which is a body",
        ),
        ({"world": {"bodies": ["EARTH"]}}, "spec.problem: departure: expected a state outside the Earth"),
        ({"departure": {"position_km": [1e5, 2e5, 0.0]}}, '.* in AU, or did you mean center = "EARTH"[?]'),
    ],
)
def test_a_world_that_cannot_be_is_refused_in_one_line(client, store, changes, detail):
    answer = client.post(f"{API}/campaigns", json=spec_fields(problem={"preset": "earth-mars"} | changes))
    assert answer.status_code == 422 and store.campaigns() == []
    assert re.fullmatch(f"{detail}[^\n]*", answer.json()["detail"])


def test_a_bug_is_a_500_without_details(client, store, monkeypatch):
    def broken(name_or_id):
        raise ZeroDivisionError("secret")

    monkeypatch.setattr(store, "campaign_cards", broken)
    answer = client.get(f"{API}/campaigns")
    assert answer.status_code == 500 and "secret" not in answer.text
    assert answer.headers["content-type"] == "application/problem+json"


def test_every_route_is_in_the_document_with_a_summary(client):
    paths = client.get(f"{API}/openapi.json").json()["paths"]
    assert f"{API}/campaigns/{{campaign_id}}/events" in paths
    assert all(operation["summary"] for path in paths.values() for operation in path.values())


def test_metrics_of_a_campaign_count_its_solves_and_pair_its_seeds(client, finished):
    body = client.get(f"{API}/campaigns/1/metrics").json()
    s0, s1 = client.get(f"{API}/campaigns/1").json()["searches"]
    drawn, seeded = body["by_strategy"]
    assert (drawn["strategy"], drawn["n_solves"], drawn["n_strict"]) == ("S(0)", 8, s0["n_strict"])
    assert drawn["strict_ratio"] == s0["n_strict"] / 8
    assert (seeded["strategy"], seeded["mapping"], seeded["n_solves"]) == (
        "S(1|0)",
        "reference",
        s1["n_solves"],
    )
    assert [(row["seed_k"], row["k"]) for row in body["seed_yields"]] == [(None, 0), (0, 1)]
    assert body["paired_changes"][0]["propellant_kg_n"] == s1["n_strict"]
    assert client.get(f"{API}/campaigns/99/metrics").status_code == 404


def test_metrics_of_a_campaign_without_solves_are_empty_tables(client, store):
    assert client.post(f"{API}/campaigns", json=spec_fields()).status_code == 201
    body = client.get(f"{API}/campaigns/1/metrics").json()
    assert body["by_strategy"] == body["seed_chains"] == body["paired_changes"] == []


def test_a_slow_table_serves_all_who_ask_until_ten_times_its_time_has_passed():
    now, made = [0.0], []

    def make():
        now[0] += 2.0
        made.append(now[0])
        return made[-1]

    tables = metrics.Tables(lambda: now[0])
    assert [tables.ask(1, n, make) for n in (10, 10, 11)] == [2.0, 2.0, 2.0]
    now[0] = 23.0
    assert tables.ask(1, 11, make) == 25.0 and len(made) == 2


def test_a_quick_table_is_made_anew_with_every_solve():
    tables = metrics.Tables(lambda: 0.0)
    assert [tables.ask(1, n, lambda n=n: n) for n in (10, 10, 11)] == [10, 10, 11]


def test_metrics_of_many_solutions_read_no_vectors(store, client, monkeypatch):
    submitted(store)
    finish(store)
    counted = client.get("/api/v1/campaigns/1/metrics").json()
    assert counted["by_strategy"][0]["n_distinct"] > 0
    monkeypatch.setattr(metrics, "MOST_COMPARED", 1)
    assert not store.campaign_facts(1, 1).vectors and store.campaign_facts(1).vectors
    client.app.state.tables = metrics.Tables()
    bare = client.get("/api/v1/campaigns/1/metrics").json()
    told = {"n_distinct": None, "distinct_per_core_hour": None}
    assert bare == counted | {
        name: [row | told for row in counted[name]] for name in ("by_strategy", "by_mapping")
    }
