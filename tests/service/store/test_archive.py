"""Filters, sorts, points and clusters of the archive."""

import numpy as np
import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.schemas.solution import RANGES, Filter
from service.store import scatter
from service.store.filters import Order
from service.store.scatter import front
from service.store.store import Store
from tests.service.campaigns import finish, spec_fields, submitted
from tests.service.databases import needs_postgres
from tests.workers.fake import run_fake
from workers.executor import Inline

API = "/api/v1"
SEARCHES = [
    {"id": "s0", "strategy": "S(0)", "guesses": 60, "hops": 2},
    {
        "id": "s1-0",
        "strategy": "S(1|0)",
        "outages": [{"segment": 24, "duration_days": 1.0}],
        "seeds": {"from": "s0"},
    },
    {
        "id": "s2-0",
        "strategy": "S(2|0)",
        "outages": [{"segment": 12, "duration_days": 0.5}, {"segment": 30, "duration_days": 1.0}],
        "seeds": {"from": "s0"},
    },
]


def run_varied(job, stop=lambda: False):
    """Answer at once, with costs that differ as the throttles do."""
    outcome = run_fake(job)
    return outcome.model_copy(update={"solves": tuple(map(varied, outcome.solves))})


def varied(solve):
    return solve if solve.x is None else solve.model_copy(update={"cpu_seconds": 1.0 + solve.x[3]})


def filled(store):
    submitted(store, spec_fields(search=SEARCHES))
    finish(store, Inline(run_varied))
    return store.all_records(Filter())


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """The store, a client, and all solutions of a campaign with three strategies."""
    with Store(tmp_path_factory.mktemp("archive")) as store:
        found = filled(store)
        with TestClient(create_app(store), base_url="http://127.0.0.1:8741") as client:
            yield store, client, found


@pytest.fixture
def store(archive):
    return archive[0]


@pytest.fixture
def client(archive):
    return archive[1]


@pytest.fixture
def found(archive):
    return archive[2]


def ids(client, **wanted):
    answer = client.get(f"{API}/solutions", params={"limit": 200} | wanted)
    assert answer.status_code == 200, answer.text
    return [record["id"] for record in answer.json()["items"]]


def test_every_filter_keeps_what_it_says_and_nothing_else(client, found):
    middle = {name: float(np.median([getattr(record, name) for record in found])) for name in RANGES}
    rules = [
        ({"strategy": "S(1|0)"}, lambda r: r.strategy == "S(1|0)"),
        ({"k": 2}, lambda r: r.k == 2),
        ({"segment": 12}, lambda r: any(o.segment == 12 for o in r.outages)),
        ({"segment": 12, "duration_days": 1.0}, lambda r: False),
        ({"duration_days": 1.0}, lambda r: any(o.duration_days == 1.0 for o in r.outages)),
        ({"tolerance": "strict"}, lambda r: r.strict),
        ({"tolerance": "paper"}, lambda r: r.paper),
        ({"search": "s0", "campaign": 1, "strict": False}, lambda r: r.search == "s0" and not r.strict),
        *(({f"min_{n}": v}, lambda r, n=n, v=v: getattr(r, n) >= v) for n, v in middle.items()),
        *(({f"max_{n}": v}, lambda r, n=n, v=v: getattr(r, n) <= v) for n, v in middle.items()),
    ]
    for wanted, rule in rules:
        expected = {record.id for record in found if rule(record)}
        assert set(ids(client, **wanted)) == expected, wanted
        assert client.get(f"{API}/solutions/points", params=wanted).json()["n"] == len(expected), wanted


@pytest.mark.parametrize(
    "sort",
    [
        "objective_kg",
        "delta_v_km_s",
        "time_of_flight_days",
        "propellant_kg",
        "cpu_seconds",
        "k",
        "created_at",
    ],
)
@pytest.mark.parametrize("descending", [True, False])
def test_pages_of_every_sort_join_to_the_whole_in_order(client, found, sort, descending):
    listed, after = [], None
    while listed == [] or after is not None:
        wanted = {"sort": sort, "descending": descending, "limit": 3} | ({"after": after} if after else {})
        page = client.get(f"{API}/solutions", params=wanted).json()
        listed += page["items"]
        after = page["next"]
    values = [record[sort] for record in listed]
    assert values == sorted(values, reverse=descending)
    assert sorted(record["id"] for record in listed) == sorted(record.id for record in found)


def test_a_page_begins_at_a_value(client, found):
    flights = sorted(record.time_of_flight_days for record in found)
    wanted = {"sort": "time_of_flight_days", "begin": flights[4], "limit": 1}
    page = client.get(f"{API}/solutions", params=wanted).json()
    assert page["items"][0]["time_of_flight_days"] == flights[4]


def test_a_download_has_what_the_filter_has(client, found):
    wanted = {"strategy": "S(1|0)", "max_delta_v_km_s": 1.0}
    text = client.get(f"{API}/solutions", params=wanted | {"format": "csv"}).text
    assert {line.split(",")[0] for line in text.splitlines()[1:]} == set(ids(client, **wanted))


@pytest.mark.parametrize(
    "wanted",
    [
        {"strategy": "S(1"},
        {"k": -1},
        {"segment": 0},
        {"min_delta_v_km_s": "nan"},
        {"tolerance": "none"},
        {"sort": "x"},
    ],
)
def test_a_filter_that_means_nothing_is_refused_by_its_name(client, wanted):
    answer = client.get(f"{API}/solutions", params=wanted)
    assert answer.status_code == 422 and next(iter(wanted)) in answer.json()["detail"]


def test_a_sample_keeps_extremes_front_and_some_of_every_search(store, found, monkeypatch):
    monkeypatch.setattr(scatter, "OF_EACH_SEARCH", 1)
    hold_sample_against(store, found)


@needs_postgres
def test_another_database_filters_and_draws_the_same(tmp_path, archives_on_postgres, monkeypatch):
    monkeypatch.setattr(scatter, "OF_EACH_SEARCH", 1)
    with Store(tmp_path) as store:
        found = filled(store)
        hold_sample_against(store, found)
        for wanted in (
            Filter(k=1, max_cpu_seconds=1.5),
            Filter(strategy="S(0)", tolerance="strict", segment=12),
        ):
            listed = store.all_records(wanted, order=Order("cpu_seconds"))
            assert store.points(wanted, 5000).n == len(listed)
        assert store.clusters(Filter(), 0.05, 50).n == len(found)
        assert store.choices(None).k == [0, 1, 2]


def hold_sample_against(store, found):
    most = 30
    view = store.points(Filter(), most)
    assert view.n == len(found) > most == len(view.id)
    for name in scatter.AXES:
        values = [getattr(record, name) for record in found]
        assert min(getattr(view, name)) == pytest.approx(min(values), abs=1e-3)  # rounded for pictures
        assert max(getattr(view, name)) == pytest.approx(max(values), abs=1e-3)
    assert set(view.strategies) == {"S(0)", "S(1|0)", "S(2|0)"}
    unbeaten = {
        one.id
        for one in found
        if not any(
            other.delta_v_km_s <= one.delta_v_km_s
            and other.time_of_flight_days <= one.time_of_flight_days
            and (other.delta_v_km_s, other.time_of_flight_days) != (one.delta_v_km_s, one.time_of_flight_days)
            for other in found
        )
    }
    assert {view.id[place] for place in view.front} == unbeaten


def test_points_of_few_solutions_are_all_of_them(client, found):
    body = client.get(f"{API}/solutions/points").json()
    records = {record.id: record for record in found}
    assert sorted(body["id"]) == sorted(records)
    for i, key in enumerate(body["id"]):
        assert body["strategies"][body["strategy"][i]] == records[key].strategy
        assert body["k"][i] == records[key].k and body["strict"][i] == records[key].strict


def test_the_front_holds_each_that_no_other_beats():
    first, second = np.array([2.0, 1.0, 3.0, 1.0, 4.0]), np.array([5.0, 9.0, 6.0, 8.0, 1.0])
    assert front(first, second).tolist() == [3, 0, 4]
    assert front(np.empty(0), np.empty(0)).tolist() == []


def test_clusters_join_equal_references_and_name_the_best(client, found):
    body = client.get(f"{API}/solutions/clusters", params={"threshold": 0, "limit": 200}).json()
    assert body["n"] == body["n_compared"] == len(found) == sum(c["size"] for c in body["items"])
    least = [cluster["min_delta_v_km_s"] for cluster in body["items"]]
    assert least == sorted(least)
    assert body["items"][0]["best_id"] == min(found, key=lambda r: (r.delta_v_km_s, r.id)).id
    wide = client.get(f"{API}/solutions/clusters", params={"threshold": 10}).json()
    assert wide["n_clusters"] == 1 and wide["items"][0]["max_distance"] > 0


def test_an_empty_archive_has_no_points_no_clusters_and_no_choices(tmp_path):
    with Store(tmp_path) as store:
        assert store.points(Filter(), 5000).n == 0
        assert store.clusters(Filter(), 0.05, 50).items == []
        assert store.choices(None).strategies == []


def test_choices_are_those_of_the_campaign(client):
    body = client.get(f"{API}/solutions/choices", params={"campaign": 1}).json()
    assert [campaign["name"] for campaign in body["campaigns"]] == ["test"]
    assert body["strategies"] == ["S(0)", "S(1|0)", "S(2|0)"] and body["segments"] == [12, 24, 30]
    assert client.get(f"{API}/solutions/choices", params={"campaign": 2}).json()["searches"] == []
    assert body["durations_days"] == [0.5, 1.0] and body["k"] == [0, 1, 2]


def test_a_filter_in_the_order_asked_for_reaches_the_terminal(store, found):
    records = store.all_records(Filter(k=1), 2, Order("time_of_flight_days"))
    flights = sorted(record.time_of_flight_days for record in found if record.k == 1)
    assert [record.time_of_flight_days for record in records] == flights[:2]


@pytest.mark.parametrize(
    ("fields", "levels"),
    [
        ({}, set()),
        ({"strict": True}, {("strict", True)}),
        ({"tolerance": "strict"}, {("strict", True)}),
        ({"tolerance": "strict", "strict": True}, {("strict", True)}),
        ({"tolerance": "paper", "strict": False}, {("paper", True), ("strict", False)}),
    ],
)
def test_two_ways_to_ask_for_a_tolerance_are_one(fields, levels):
    assert Filter(**fields).levels() == levels
