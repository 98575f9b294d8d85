"""`coastarc solutions verify` on real solutions, flown by SciPy and SPICE."""

import json
import os
import shutil
import signal
import sys
from importlib.util import find_spec

import pytest
from sqlalchemy import update

from core.plain_data import content_hash
from service import cli
from service.cli import solution_commands as cli_verify
from service.cli.options import console
from service.cli.terminal import level_of
from service.db.tables import SolutionRow
from service.schemas.solution import Filter
from service.solutions import verification
from service.solutions.verification import VerificationRequest, verify_solutions
from service.spec import spec_from
from service.store.store import Store
from tests.acceptance.known import OUTAGE, SPEC, run_known
from tests.service.campaigns import finish, spec_fields
from workers.executor import Inline

needs_heyoka = pytest.mark.skipif(
    find_spec("heyoka") is None, reason="heyoka is an extra: pip install -c constraints.txt -e '.[heyoka]'"
)
SMALL = SPEC | {"search": [SPEC["search"][0] | {"guesses": 1}, SPEC["search"][1]]}


@pytest.fixture(scope="module")
def verified(tmp_path_factory):
    """An archive of one P_0 and the P_1 that it seeded, both certified, and how that went."""
    folder = tmp_path_factory.mktemp("verified")
    with Store(folder) as store:
        store.submit(spec_from(SMALL))
        finish(store, Inline(run_known))
        ids = store.certificates.ids(Filter())
        items = list(verify_solutions(store, ids, VerificationRequest()))
    return folder, items


@pytest.fixture
def archive(verified, tmp_path):
    return shutil.copytree(verified[0], tmp_path / "archive")


@pytest.fixture
def coastarc(archive, monkeypatch, capsys):
    """Return a function that runs a command on the archive: (exit code, stdout, stderr)."""
    monkeypatch.setattr(console, "_width", 200)

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["coastarc", *map(str, words), "--data", str(archive)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, *capsys.readouterr()

    return call


def test_known_solutions_are_good_and_arrive_though_nothing_is_corrected(verified):
    _, items = verified
    assert [item.level for item in items] == ["strict", "strict"]
    # Closed to 1e-12 by another integrator: what is left grows a hundredfold on the way, to metres.
    assert all(item.is_good and item.is_new and item.arrival_miss_km < 1.0 for item in items)


def test_a_certificate_hashes_its_content_and_names_what_it_was_made_with(archive):
    with Store(archive, read_only=True) as store:
        robust = store.certificates.latest(store.certificates.ids(Filter(k=1))[0])
    content = robust.content
    assert robust.hash == content_hash(content.model_dump(mode="json"))
    assert [one.outage_segment for one in content.trajectories] == [None, OUTAGE["segment"]]
    assert content.kernels["de440.bsp"] == "c9d581bfd84209dbeee8b1583939b148"
    assert {"numpy", "scipy", "spiceypy"} <= set(content.package_versions) and content.constants[
        "G0"
    ] == 9.806


def test_two_processes_find_the_certificates_again_that_one_made_before(archive, verified):
    with Store(archive) as store:
        items = list(
            verify_solutions(store, [item.solution_id for item in verified[1]], VerificationRequest(), 2)
        )
        first = store.certificates.latest(items[0].solution_id)
    assert {item.hash for item in items} == {item.hash for item in verified[1]}
    assert not any(item.is_new for item in items) and first.checked_at > first.made_at


def test_stale_leaves_out_what_was_found_sound_with_the_same_settings(coastarc, verified):
    code, said, _ = coastarc("solutions", "verify", "--all", "--stale")
    assert code == 0 and "0 verified, 0 failed; 2 skipped, found sound before" in said


def test_a_passage_below_the_altitude_asked_for_fails_and_is_named(coastarc, verified):
    first = verified[1][0]
    limit = first.moon_altitude_km + 1.0
    words = ("solutions", "verify", first.solution_id[:8], "--stale", "--min-altitude-km", limit)
    code, said, _ = coastarc(*words, "--workers", 1)
    assert code == 1 and "1 verified, 1 failed" in said
    assert f"passes the Moon at {first.moon_altitude_km:.3f} km on 2026-" in said


@pytest.mark.parametrize("altitude_km", [-1, "nan", "inf"])
def test_a_lowest_passage_that_is_none_is_refused_in_one_line(coastarc, altitude_km):
    code, said, fault = coastarc("solutions", "verify", "--all", "--min-altitude-km", altitude_km)
    assert code != 0 and not said
    assert "min_altitude_km: expected a number of at least 0, which is the surface, got" in fault


def test_every_solution_is_listed_with_its_lowest_passages(coastarc, verified):
    known = {item.solution_id: item for item in verified[1]}
    code, said, _ = coastarc("solutions", "list", "--json")
    listed = json.loads(said)
    assert code == 0 and {one["id"] for one in listed} == set(known)
    for one in listed:
        # What the solve's own verification saw is what a certificate sees.
        assert one["moon_altitude_km"] == known[one["id"]].moon_altitude_km
        assert one["earth_altitude_km"] == known[one["id"]].earth_altitude_km
        assert one["is_marginal"] is False
    assert "km over the Moon" in coastarc("solutions", "show", listed[0]["id"])[1]


@pytest.mark.parametrize(
    ("verification", "shown"),
    [
        ({"is_marginal": True, "lowest_km": {"Moon": 7.0}}, (True, None, 7.0)),
        ({"lowest_km": "?"}, (None,) * 3),
    ],
)
def test_what_a_verification_says_beside_its_level_is_shown_where_it_is_there(archive, verification, shown):
    with Store(archive) as store:
        first = store.certificates.ids(Filter())[0]
        change = update(SolutionRow).where(SolutionRow.id == first).values(verification=verification)
        store._database.write(lambda session: session.execute(change))
        record = store.record(first)
    assert (record.is_marginal, record.earth_altitude_km, record.moon_altitude_km) == shown
    assert level_of(record) == ("strict, marginal" if shown[0] else "strict")


def test_a_solution_that_claims_what_it_does_not_hold_fails(coastarc, archive):
    with Store(archive) as store:
        campaign, _ = store.submit(
            spec_from(spec_fields(guesses=2, campaign={"name": "made up", "rng_seed": 3}))
        )
        finish(store, n_steps=2)
        n_made_up = len(store.certificates.ids(Filter(campaign=campaign)))
    code, said, _ = coastarc("solutions", "verify", "--campaign", "made up", "--json", "--workers", 1)
    found = json.loads(said)
    assert code == 1 and found["n_failed"] == n_made_up > 0
    assert all(item["reasons"] and item["level"] == "none" for item in found["items"])


def test_an_interruption_keeps_what_was_done(coastarc, monkeypatch):
    def interrupted(*arguments):
        yield next(iter(verify_solutions(*arguments)))
        raise KeyboardInterrupt

    monkeypatch.setattr(cli_verify, "verify_solutions", interrupted)
    code, said, _ = coastarc("solutions", "verify", "--all", "--workers", 1)
    assert code == 130 and "1 verified, 0 failed" in said and "--stale verifies the rest" in said


def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_process_that_is_killed_over_a_flight_is_one_line(coastarc, monkeypatch):
    monkeypatch.setattr(verification, "_certify", die)
    code, _, said = coastarc("solutions", "verify", "--all", "--workers", 2)
    assert code == 2 and "got one that was killed" in said and "--stale goes on" in said
    assert len(said.strip().splitlines()) == 1


def test_a_certificate_is_shown_with_its_solution(coastarc, verified):
    best = verified[1][0]
    _, said, _ = coastarc("solutions", "show", best.solution_id)
    assert f"certificate: {best.hash}, strict, sound" in said and "reference" in said
    _, said, _ = coastarc("solutions", "show", best.solution_id, "--json")
    assert json.loads(said)["certificate"]["hash"] == best.hash


@pytest.mark.parametrize("words", [(), ("abc", "--all"), ("--campaign", "1", "--all")])
def test_one_way_to_name_solutions_is_needed(coastarc, words):
    code, _, said = coastarc("solutions", "verify", *words)
    assert code == 2 and "expected ids of solutions, --campaign or --all" in said and "\n" not in said.strip()


def test_nobody_who_did_not_ask_for_a_third_flight_finds_a_trace_of_it(archive, verified):
    with Store(archive, read_only=True) as store:
        found = store.certificates.latest(verified[1][0].solution_id)
    assert "third" not in found.content.model_dump(mode="json") and verified[1][0].third_apart_km is None


def test_heyoka_that_is_not_installed_is_one_line_with_its_remedy(coastarc, monkeypatch):
    monkeypatch.setattr(verification, "find_spec", lambda name: None)
    code, said, complaint = coastarc("solutions", "verify", "--all", "--with-heyoka")
    assert (code, said) == (2, "") and complaint.count("\n") == 1
    assert "expected the package heyoka, got none; install it" in complaint


@needs_heyoka
def test_a_third_flight_agrees_and_changes_nothing_else_in_the_certificate(coastarc, archive, verified):
    best = verified[1][0]
    words = ("solutions", "verify", best.solution_id, "--with-heyoka", "--workers", 1)
    code, said, _ = coastarc(*words, "--stale", "--json")
    (item,) = json.loads(said)["items"]
    # What two integrators may differ by: see tests/core/analysis/test_third.py.
    assert code == 0 and item["is_new"] and 0.0 < item["third_apart_km"] < 0.05
    with Store(archive, read_only=True) as store:
        content = store.certificates.latest(best.solution_id).content
    assert content_hash(content.model_dump(mode="json")) == item["hash"]
    assert content_hash(content.model_copy(update={"third": None}).model_dump(mode="json")) == best.hash
    assert "heyoka differs by at most" in coastarc(*words)[1]
    assert (
        "propagated end to end by heyoka.taylor_adaptive"
        in coastarc("solutions", "show", best.solution_id)[1]
    )
    assert "1 skipped, found sound before" in coastarc(*words, "--stale")[1]
