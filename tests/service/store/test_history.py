"""What campaigns have found, as it is kept in memory, against the archive's own tables and metrics."""

import threading

import numpy as np
import pytest

from service.coordinator.coordinator import read_history
from service.spec import spec_from
from service.store import campaign_history
from service.store.campaign_history import MOST_BINS, OutcomeBins, Step, sparkline
from service.store.store import Store
from tests.service.campaigns import dispatcher_on, finish, spec_fields
from tests.workers.fake import run_fake
from workers.executor import Inline


@pytest.fixture
def finished(store):
    """An archive with a campaign whose solves are those of `tests.workers.fake`."""
    store.submit(spec_from(spec_fields()))
    finish(store, Inline(run_fake))
    return store


def test_a_card_says_what_the_campaign_itself_says(finished, client):
    card = client.get("/api/v1/campaigns").json()["items"][0]
    view = client.get("/api/v1/campaigns/1").json()
    same = ("n_jobs", "n_done", "n_solves", "n_solutions", "best_delta_v_km_s", "cpu_seconds", "eta_seconds")
    assert {name: card[name] for name in same} == pytest.approx({name: view[name] for name in same})
    assert card["outcomes"]["strict"] == sum(search["n_strict"] for search in view["searches"])
    assert sum(card["outcomes"].values()) == card["n_read"] == card["n_solves"]
    assert card["sparkline_km_s"][-1] == card["best_delta_v_km_s"] and len(card["sparkline_km_s"]) == 60


def test_chains_are_those_of_the_metrics(finished, client):
    chains = client.get("/api/v1/campaigns/1/history").json()["chains"]
    yields = client.get("/api/v1/campaigns/1/metrics").json()["seed_yields"]
    same = ("seed_k", "k", "n_seeds", "n_solves", "n_strict")
    assert [[c[n] for n in same] for c in chains] == [[y[n] for n in same] for y in yields]
    for chain, row in zip(chains, yields, strict=True):
        assert chain["core_seconds_per_strict"] == pytest.approx(row["core_seconds_per_strict"])
        assert chain["strict_ratio"]["low"] == pytest.approx(row["strict_ratio_low"])


def test_steps_only_improve_and_end_with_the_best_of_the_strategy(finished, client):
    view = client.get("/api/v1/campaigns/1").json()
    best = {search["strategy"]: search["best_delta_v_km_s"] for search in view["searches"]}
    for one in client.get("/api/v1/campaigns/1/history").json()["strategies"]:
        values = [step["delta_v_km_s"] for step in one["steps"]]
        assert values == sorted(values, reverse=True) and values[-1] == best[one["strategy"]]
        hours = [step["core_hours"] for step in one["steps"]]
        assert hours == sorted(hours) and hours[-1] <= one["core_hours"]


def test_a_tally_read_in_pieces_is_that_read_at_once(finished, monkeypatch):
    whole = finished.campaign_history(1)
    monkeypatch.setattr(campaign_history, "_SOLVES", campaign_history._SOLVES.limit(3))
    monkeypatch.setattr(campaign_history, "CHUNK", 3)
    with Store(finished.folder, read_only=True) as again:
        assert again.campaign_history(1) == whole


def test_new_solves_are_added_to_those_that_are_known(store):
    store.submit(spec_from(spec_fields()))
    work, seen = dispatcher_on(store, Inline(run_fake)), []
    while any(item.state != "done" for item in store.campaigns()):
        work.step()
        seen.append(store.campaign_history(1).n_read)
    assert seen == sorted(seen) and seen[-1] == store.campaign(1).n_solves > 5
    with Store(store.folder, read_only=True) as again:
        assert again.campaign_history(1) == store.campaign_history(1)


def test_a_long_answer_stops_reading_and_says_how_far_it_is(finished, monkeypatch):
    monkeypatch.setattr(campaign_history, "_SOLVES", campaign_history._SOLVES.limit(2))
    monkeypatch.setattr(campaign_history, "CHUNK", 2)
    monkeypatch.setattr(campaign_history, "PATIENCE_S", 0.0)
    with Store(finished.folder, read_only=True) as again:
        first = again.campaign_history(1)
        assert first.n_read == 2 < first.n_solves
        assert again.campaign_history(1).n_read == 4


def test_a_campaign_that_does_not_exist_has_no_history(client):
    assert client.get("/api/v1/campaigns/9/history").status_code == 404


def test_bins_grow_wider_and_lose_nothing():
    bins, rng = OutcomeBins(1000.0), np.random.default_rng(3)
    for age in (10.0, 119.0, 121.0, 4e3, 3e5):
        bins.add(rng.integers(0, 5, 50), 1000.0 + rng.uniform(0.0, age, 50))
    assert bins.counts.sum() == 250 and bins.counts.shape[1] <= MOST_BINS
    assert 3e5 / bins.width_s <= MOST_BINS


def test_a_sparkline_holds_each_best_until_the_next():
    steps = [Step(50.0, 0.4, "a"), Step(100.0, 0.3, "b")]
    line = sparkline(steps, 0.0, 100.0)
    assert line[0] is None and line[31] == 0.4 and line[-1] == 0.3


def test_a_coordinator_reads_the_whole_archive_before_anybody_asks(finished, monkeypatch):
    whole = finished.campaign_history(1)
    monkeypatch.setattr(campaign_history, "_SOLVES", campaign_history._SOLVES.limit(2))
    monkeypatch.setattr(campaign_history, "CHUNK", 2)
    monkeypatch.setattr(campaign_history, "PATIENCE_S", 0.0)
    with Store(finished.folder, read_only=True) as again:
        read_history(again, threading.Event())
        assert again.campaign_history(1) == whole


def test_reading_ahead_ends_when_it_is_told_to(finished, monkeypatch):
    monkeypatch.setattr(campaign_history, "_SOLVES", campaign_history._SOLVES.limit(2))
    monkeypatch.setattr(campaign_history, "CHUNK", 2)
    monkeypatch.setattr(campaign_history, "PATIENCE_S", 0.0)
    stop = threading.Event()
    stop.set()
    with Store(finished.folder, read_only=True) as again:
        read_history(again, stop)
        assert again.campaign_history(1).n_read == 4  # One piece by itself, one for the question.


@pytest.mark.parametrize("step_s", [0.4, 31.7, 250.0])
def test_the_rate_of_a_campaign_is_the_same_in_the_list_and_by_itself(tmp_path, step_s):
    now = [1_800_000_001.3]
    with Store(tmp_path, clock=lambda: now[0]) as store:
        store.submit(spec_from(spec_fields(guesses=24)))
        work, rates = dispatcher_on(store, Inline(run_fake)), []
        while any(item.state != "done" for item in store.campaigns()):
            work.step()
            now[0] += step_s
            rates.append((store.campaign_cards()[0].rate_per_min, store.campaign(1).rate_per_min))
        # A campaign that has ended keeps the rate of its end.
        now[0] += 3600.0
        rates.append((store.campaign_cards()[0].rate_per_min, store.campaign(1).rate_per_min))
    assert all(card == pytest.approx(view) for card, view in rates) and rates[-1] == rates[-2]
    assert max(rates) > (0.0, 0.0)
