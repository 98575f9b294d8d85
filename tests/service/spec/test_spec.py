import copy
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.spec import SpecError, load_spec, spec_from
from service.spec.spec_check import check_text, require_flyable
from tests.service.campaigns import OUTAGE, spec_fields


def changed(**more):
    """Return the specification with other fields in its second search; None removes one."""
    fields = copy.deepcopy(spec_fields())
    fields["search"][1].update(more)
    fields["search"][1] = {name: value for name, value in fields["search"][1].items() if value is not None}
    return fields


OUTAGE_40 = {"segment": 40, "duration_days": 1.0}


def cases(listed, duration_days=1.0, **more):
    """Return the specification with several cases in its second search."""
    given = {"cases": listed, "duration_days": duration_days, "outages": more.get("outages")}
    return changed(**given)


def with_laws(**laws):
    """Return the specification with other laws in its first search."""
    fields = spec_fields()
    fields["search"][0].update(laws)
    return fields


def third(**more):
    """Return the specification with a third search, S(2|1) unless told otherwise."""
    fields = copy.deepcopy(spec_fields())
    search = {"id": "s2-1", "strategy": "S(2|1)", "outages": [OUTAGE, OUTAGE_40], "seeds": {"from": "s1-0"}}
    fields["search"].append(search | more)
    return fields


REFUSED = [
    (changed(colour="red"), "spec.search.1.colour: expected one of id, strategy, "),
    (changed(seeds={"from": "s9"}), "search s1-0: seeds.from: expected one of s0, s1-0, got 's9'"),
    (changed(seeds={"from": "s1-0"}), "expected a search of S(0...) for S(1|0), got 's1-0', which is S(1|0)"),
    (changed(seeds={"from": "s0", "pairing": "some"}), "spec.search.1.seeds.pairing"),
    (changed(seeds={"from": "s0", "tolerance": "loose"}), "spec.search.1.seeds.tolerance"),
    (changed(seeds={"from": "s0", "limit": 0}), "spec.search.1.seeds.limit"),
    (changed(seeds={"from": "s0", "order": "colour"}), "spec.search.1.seeds.order"),
    (changed(seeds=None), "seeds: expected a table with `from` or `solution` for S(1|0), got none"),
    (changed(strategy="S(0|0)", outages=None), "expected k' < k, or k' = k for longer outages, got S(0|0)"),
    (changed(strategy="S(1|2)"), "expected k' < k, or k' = k for longer outages, got S(1|2)"),
    (changed(strategy="S(1|1)", seeds={"from": "s1-0"}), "expected the same segments and longer outages"),
    (changed(strategy="S(2|0)"), "outages: expected 2 for S(2|0), got 1"),
    (changed(strategy="T(1)"), "spec.search.1.strategy: expected S(k) or S(k|k'), got 'T(1)'"),
    (changed(outages=[]), "outages: expected 1 for S(1|0), got 0"),
    (changed(outages=[{"segment": 50, "duration_days": 1.0}]), "expected a segment in 1..49"),
    (changed(outages=[OUTAGE, OUTAGE], strategy="S(2|0)"), "got segment 24 with 1.0 days twice"),
    (changed(hops=3), "hops: expected to be absent for S(1|0), got 3"),
    (cases([[4], [8, 12]]), "case [8, 12]: expected 1 for S(1|0), got 2"),
    (cases([[4], [4]]), "cases: expected different ones, got one of them twice"),
    (cases([]), "cases: expected at least one, got none"),
    (cases([[4], [50]]), "expected a segment in 1..49"),
    (cases([[4]], duration_days=None), "duration_days: expected beside cases, got none"),
    (cases([[4]], outages=[OUTAGE]), "cases: expected instead of outages, got both"),
    (changed(duration_days=1.0), "duration_days: expected beside cases, got it without"),
    (
        third(
            seeds={"from": "s1-0", "pairing": "contained"},
            outages=[{"segment": 4, "duration_days": 1.0}] * 1 + [OUTAGE_40],
        ),
        "expected a case that holds its own, got no such pair of cases from 's1-0'",
    ),
    (
        third(outages=[{"segment": n, "duration_days": 0.5} for n in (24, 40)]),
        "expected outages of 0.5 days, got 's1-0' with 1; set any_duration to allow it",
    ),
    (third(mapping=[1]), "search s2-1: mapping"),
    (third(mapping=[1, 2]), "search s2-1: mapping"),
    (third(strategy="S(1|0)", outages=[OUTAGE], seeds={"from": "s0"}), "each seed, mapping and case once"),
    (changed(guess_law="uniform"), "guess_law: expected to be absent for S(1|0), got 'uniform'"),
    (with_laws(hop_law="levy"), "expected one of uniform, gaussian, cauchy, pareto, got 'levy'"),
    (with_laws(hop_shape=0.7), "hop_shape: expected "),
    (with_laws(hop_law="pareto", hop_shape=99), "spec.search.0.hop_shape"),
    (with_laws(time_hop_probability=1.5), "spec.search.0.time_hop_probability"),
    (with_laws(adaptive=True, hop_width=0.9), "hop_width: expected "),
    (changed(mapping="magic"), "spec.search.1.mapping.0: mapping: expected "),
    (changed(mapping=[]), "spec.search.1.mapping"),
    (changed(id="s0"), "expected different ids, got 's0' 2 times"),
    (changed(cpu_seconds=0), "spec.search.1.cpu_seconds: expected a number greater than 0, got 0"),
    (changed(cpu_seconds=float("nan")), "spec.search.1.cpu_seconds"),
    (
        spec_fields(
            search=[
                {"id": "a", "strategy": "S(1)", "cases": [[4], [8]], "duration_days": 1.0} | {"guesses": 1}
            ]
        ),
        "guesses: expected at least one for each of 2 cases, got 1",
    ),
    (spec_fields(guesses=0), "spec.search.0.guesses: expected a number of at least 1, got 0"),
    (
        spec_fields(guesses=None),
        "budget: expected at least one of guesses, core_seconds, solutions, got none",
    ),
    (spec_fields(search=[]), "spec.search: expected at least 1 item, got 0"),
    (spec_fields(campaign={"name": "x", "rng_seed": -1}), "spec.campaign.rng_seed"),
    (spec_fields(campaign={"name": "../x", "rng_seed": 1}), "spec.campaign.name: expected 1 to 80 letters, "),
    (spec_fields(problem={"preset": "moon-shot"}), "expected one of earth-mars, ppe-drm3, got 'moon-shot'"),
    (spec_fields(problem={"preset": "ppe-drm3", "outages": [OUTAGE]}), "outages: expected none here"),
    (
        spec_fields(problem={"preset": "ppe-drm3", "n_segments": -3}),
        "spec.problem.n_segments: expected a number of at",
    ),
    ([], "spec: expected tables campaign, problem and search, got list"),
]


@pytest.mark.parametrize(("fields", "reason"), REFUSED, ids=[reason[:50] for _, reason in REFUSED])
def test_what_cannot_be_run_is_refused_with_field_value_and_reason(fields, reason):
    with pytest.raises(SpecError) as refusal:
        spec_from(fields)
    assert reason in str(refusal.value) and str(refusal.value).count("\n") == 0


def test_a_chain_may_not_name_a_mapping_or_seeds():
    for more in ({"mapping": "reference"}, {"seeds": {"from": "s0"}}):
        fields = spec_fields()
        fields["search"][0].update(more)
        with pytest.raises(SpecError, match=r"expected to be absent for S\(0\)"):
            spec_from(fields)


def test_a_file_named_over_the_network_is_refused_unread(tmp_path):
    problem = {
        "preset": "ppe-drm3",
        "target": {"kind": "spk", "path": str(tmp_path / "no.bsp"), "naif_id": -7},
    }
    with pytest.raises(SpecError, match="without a file over the network"):
        spec_from(spec_fields(problem=problem))
    with pytest.raises(SpecError, match="is not a file"):
        spec_from(spec_fields(problem=problem), allow_files=True)


def test_toml_and_json_say_the_same(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps(spec_fields()))
    (tmp_path / "a.toml").write_text(TOML)
    assert load_spec(tmp_path / "a.toml").hash == load_spec(tmp_path / "a.json").hash


def test_a_file_that_is_no_toml_is_refused_in_one_line(tmp_path):
    (tmp_path / "a.toml").write_text("[campaign\n")
    with pytest.raises(SpecError, match=r"expected a readable \.toml or \.json file") as refusal:
        load_spec(tmp_path / "a.toml")
    assert "\n" not in str(refusal.value)


@given(k=st.integers(0, 12), guesses=st.integers(1, 10**6), hops=st.integers(1, 50))
def test_a_specification_survives_its_own_plain_data(k, guesses, hops):
    outages = [{"segment": 1 + 4 * i, "duration_days": 0.5} for i in range(k)]
    search = {"id": "a", "strategy": f"S({k})", "outages": outages, "guesses": guesses, "hops": hops}
    spec = spec_from(spec_fields(search=[search]))
    again = spec_from(json.loads(json.dumps(spec.as_fields())))
    assert again == spec and again.hash == spec.hash


def test_a_different_budget_is_a_different_campaign():
    assert spec_from(spec_fields(guesses=8)).hash != spec_from(spec_fields(guesses=9)).hash


def test_when_work_is_done_does_not_make_another_campaign():
    fields = spec_fields(campaign={"name": "test", "rng_seed": 7, "priority": 5})
    fields["search"][0] |= {"weight": 2.0, "priority": -1}
    assert spec_from(fields).hash == spec_from(spec_fields()).hash


TOML = """
[campaign]
name = "test"
rng_seed = 7
[problem]
preset = "ppe-drm3"
[[search]]
id = "s0"
strategy = "S(0)"
guesses = 8
hops = 2
[[search]]
id = "s1-0"
strategy = "S(1|0)"
outages = [{ segment = 24, duration_days = 1.0 }]
seeds = { from = "s0" }
"""


def test_the_cases_of_a_search_are_one_problem_each():
    spec = spec_from(cases([[24], [4], [48]], 0.5))
    assert [p.outages[0].segment for p in spec.problems_of(spec.search[1])] == [24, 4, 48]
    assert {p.outages[0].duration_days for p in spec.problems_of(spec.search[1])} == {0.5}


def test_a_mapping_may_be_one_several_or_an_assignment():
    assert spec_from(third(mapping="all")).search[2].mapping == ("all",)
    assert spec_from(third(mapping=[1, 0])).search[2].mapping == ("reference(1,0)",)
    assert spec_from(third(mapping=["reference", "nearest"])).search[2].mapping == ("reference", "nearest")


def test_longer_outages_may_start_from_shorter_ones_at_the_same_segments():
    longer = {"outages": [{"segment": 24, "duration_days": 1.5}], "strategy": "S(1|1)"}
    assert spec_from(third(**longer)).search[2].seed_k == 1


def test_seeds_of_another_duration_are_taken_when_asked_for():
    outages = [{"segment": n, "duration_days": 0.5} for n in (24, 40)]
    fields = third(outages=outages, seeds={"from": "s1-0", "any_duration": True})
    assert spec_from(fields).search[2].durations == {0.5}


def test_several_budgets_may_be_given():
    spec = spec_from(spec_fields(search=[{"id": "a", "strategy": "S(0)", "guesses": 3, "core_seconds": 9.0}]))
    assert (spec.search[0].guesses, spec.search[0].core_seconds) == (3, 9.0)


def test_both_kinds_of_search_may_set_their_legs():
    assert spec_from(changed(n_legs=5)).search[1].settings.n_legs == 5


@pytest.mark.parametrize("mark", ["\ufeff", ""])
def test_a_byte_order_mark_before_a_specification_means_nothing(tmp_path, mark):
    (tmp_path / "a.toml").write_text(mark + TOML, encoding="utf-8")
    (tmp_path / "b.toml").write_text(TOML, encoding="utf-16")
    assert load_spec(tmp_path / "a.toml") == load_spec(tmp_path / "b.toml") == check_text(mark + TOML).spec


def test_a_damaged_kernel_is_refused_in_one_line_before_anything_runs(tmp_path):
    (tmp_path / "orbit.bsp").write_bytes(b"DAF/SPK " + bytes(5000))
    target = {"kind": "spk", "path": "orbit.bsp", "naif_id": -7}
    fields = spec_fields(problem={"preset": "ppe-drm3", "target": target})
    (tmp_path / "a.json").write_text(json.dumps(fields))
    with pytest.raises(SpecError, match=r"^spec\.problem: target .*: expected a sound SPK kernel, got"):
        require_flyable(load_spec(tmp_path / "a.json").problem)


@pytest.mark.parametrize("path", ["a\0b", "x" * 300, "x/" * 3000, ".", ""])
def test_a_path_that_is_none_is_refused(path, tmp_path):
    target = {"kind": "spk", "path": path, "naif_id": -7}
    fields = spec_fields(problem={"preset": "ppe-drm3", "target": target})
    (tmp_path / "a.json").write_text(json.dumps(fields))
    with pytest.raises(SpecError, match=r"spec\.problem\.target.*expected "):
        load_spec(tmp_path / "a.json")
