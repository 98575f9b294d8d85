"""Commands that steer and follow campaigns, against a coordinator on loopback."""

import json
import sys
from types import SimpleNamespace

import pytest

from service import cli
from service.cli import control
from service.cli.options import console
from service.client import ClientError
from service.coordinator import Coordinator
from service.schemas.job import EventView
from tests.service.campaigns import finish, spec_fields, submitted
from tests.workers.fake import run_broken
from tests.workers.jobs import worker_info
from workers.executor import Inline


@pytest.fixture
def coordinator(tmp_path):
    with Coordinator(tmp_path) as opened:
        yield opened


@pytest.fixture
def coastarc(coordinator, monkeypatch, capsys):
    """Return a function that runs a command with --url in this process: (exit code, stdout, stderr)."""
    monkeypatch.setattr(console, "_width", 200)

    def call(*arguments, url=coordinator.url):
        monkeypatch.setattr(sys, "argv", ["coastarc", *map(str, arguments), "--url", url])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    return call


def test_a_campaign_is_paused_resumed_and_cancelled_by_name(coastarc, coordinator):
    campaign_id = submitted(coordinator.store)
    assert "Campaign 1 (test) is paused." in coastarc("pause", "test")[1]
    assert "Search s0 of campaign 1 (test) is paused." in coastarc("pause", 1, "--search", "s0")[1]
    assert json.loads(coastarc("resume", 1, "--json")[1])["state"] == "active"
    assert "is cancelled" in coastarc("cancel", "test")[1]
    code, _, printed = coastarc("resume", 1)
    assert code == 2 and "cancelled" in printed and printed.count("\n") == 1
    assert coordinator.store.campaign(campaign_id).state == "cancelled"


def test_shares_of_the_workers_are_changed_and_shown(coastarc, coordinator):
    submitted(coordinator.store)
    shown = coastarc("share", "test", "--search", "s0", "--weight", 2.5, "--priority", 3)[1]
    assert "2.5" in shown and "priority 0" in shown
    coastarc("share", 1, "--priority", -7)
    view = coordinator.store.campaign(1)
    assert (view.priority, view.searches[0].weight, view.searches[0].priority) == (-7, 2.5, 3)
    for wrong in ((), ("--weight", 2.0)):
        code, _, printed = coastarc("share", 1, *wrong)
        assert code == 2 and "share: expected" in printed


def test_status_shows_workers_leases_rates_and_dead_jobs(coastarc, coordinator):
    store = coordinator.store
    submitted(store)
    finish(store, Inline(run_broken))
    submitted(store, spec_fields(campaign={"name": "other", "rng_seed": 1}))
    store.register(worker_info("node7:1"))
    assert store.claim("node7:1", 1)
    status = json.loads(coastarc("status", "--json")[1])
    assert [campaign["state"] for campaign in status["campaigns"]] == ["active", "done"]
    assert {"rate_per_min", "eta_seconds"} <= set(status["campaigns"][0])
    assert status["workers"][0]["held"][0]["attempt"] == 1
    assert all("ZeroDivisionError" in job["error"] for job in status["dead_jobs"])
    shown = coastarc("status")[1]
    assert "node7:1" in shown and "ZeroDivisionError: oh" in shown and "1/min" in shown


def test_watch_follows_a_campaign_to_its_end(coastarc, coordinator):
    submitted(coordinator.store)
    finish(coordinator.store)
    assert "test: done" in coastarc("watch", "test")[1]
    events = [json.loads(line) for line in coastarc("watch", "test", "--json")[1].splitlines()]
    assert events[-1]["kind"] == "campaign" and events[-1]["data"]["state"] == "done"


def event(number, **data):
    return EventView(id=number, campaign_id=1, kind="campaign", data=data, created_at=0.0)


class Breaking:
    """A coordinator whose stream breaks after each event."""

    told = (event(1, state="active"), event(2, state="paused"), event(3, state="done"))

    def follow(self, campaign_id, after):
        yield next(one for one in self.told if one.id > (after or 0))
        raise ClientError("coordinator: expected one, got a connection that broke")

    def events(self, after, campaign_id):
        return [one for one in self.told if one.id > after]

    def campaign(self, campaign_id):
        return SimpleNamespace(state="done")


def test_each_event_is_told_once_where_a_stream_breaks():
    assert [one.id for one in control.events_of(Breaking(), 1)] == [1, 2, 3]


def test_seeds_are_shown_for_a_search_and_for_a_problem(coastarc, coordinator):
    submitted(coordinator.store)
    finish(coordinator.store)
    page = json.loads(coastarc("seeds", "--campaign", "test", "--search", "s1-0", "--json")[1])
    assert page["items"] and page["items"][0]["job_state"] == "done"
    problem = page["items"][0]["problem_hash"]
    shown = coastarc("seeds", "--problem", problem, "--outage", "30:1.0", "--k", 0, "--mapping", "reference")
    assert shown[0] == 0 and page["items"][0]["seed_id"][:8] in shown[1] and "30:1" in shown[1]
    assert "expected --campaign and --search, or --problem" in coastarc("seeds", "--campaign", "test")[2]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--executor", "process", "--address", "node7:6379"), "--address: expected --executor ray with it"),
        (("--executor", "inline", "--workers", 2), "--workers: expected 1 with --executor inline, got 2"),
        (("--token-file", "/nowhere/token"), "--token-file: expected a file with a token, got /nowhere"),
    ],
)
def test_options_of_a_dispatcher_that_do_not_go_together_are_refused(coastarc, arguments, reason):
    code, _, printed = coastarc("dispatch", *arguments)
    assert code == 2 and reason in printed


@pytest.mark.parametrize("command", [("watch", 1), ("pause", 1), ("status",), ("seeds", "--campaign", 1)])
def test_without_a_coordinator_a_command_says_how_to_start_one(coastarc, command):
    more = ("--search", "s0") if command[0] == "seeds" else ()
    code, _, printed = coastarc(*command, *more, url="http://127.0.0.1:9")
    assert code == 2 and "start one with `coastarc serve`" in printed and printed.count("\n") == 1
