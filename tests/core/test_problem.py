"""What a problem refuses, with the field, the value and the reason, and what its hash depends on."""

import json
import tomllib
from datetime import datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.epochs import seconds_past_j2000
from core.orbits import target_kernel
from core.problem import ProblemError, load_problem, presets, problem_from

PRESET = load_problem("ppe-drm3")
WITH_TWO = PRESET.with_outages([(12, 1.0), (24, 0.5)])

#: Change to the preset, and what the message must contain: the field and, after it, the reason or the value.
REFUSALS = [
    ({"spacecraft": {"wet_mass_kg": -1.0}}, r"problem\.spacecraft\.wet_mass_kg: .*greater than 0, got -1\.0"),
    ({"spacecraft": {"dry_mass_kg": -5.0}}, r"problem\.spacecraft\.dry_mass_kg: .*greater than 0, got -5\.0"),
    (
        {"spacecraft": {"dry_mass_kg": 15000.0}},
        r"expected dry_mass_kg < wet_mass_kg, got 15000\.0 >= 15000\.0",
    ),
    ({"spacecraft": {"max_thrust_n": 0.0}}, r"problem\.spacecraft\.max_thrust_n: .*greater than 0, got 0\.0"),
    ({"spacecraft": {"isp_s": float("nan")}}, r"problem\.spacecraft\.isp_s: .*, got nan"),
    (
        {"spacecraft": {"isp_s": float("inf")}},
        r"problem\.spacecraft\.isp_s: expected a finite number, got inf",
    ),
    ({"departure": {"mass_kg": -13276.0}}, r"problem\.departure\.mass_kg: .*, got -13276\.0"),
    (
        {"departure": {"mass_kg": 15001.0}},
        r"departure\.mass_kg: expected at most wet_mass_kg .*, got 15001\.0",
    ),
    ({"departure": {"position_km": [1.0, 2.0, float("nan")]}}, r"position_km\.2: .*finite number, got nan"),
    (
        {"departure": {"velocity_km_s": [1.0, 2.0]}},
        r"problem\.departure\.velocity_km_s\.2: expected a value, got none",
    ),
    ({"departure": {"epoch": "1500-01-01T00:00:00"}}, r"epoch inside the kernel DE440, .*got '1500-01-01"),
    ({"departure": {"epoch": "2650-01-01T00:00:00"}}, r"latest arrival at least 45 .*got 2650-07-20"),
    ({"departure": {"epoch": "1550-02-01T00:00:00"}}, r"departure at least 45 .*DE440.*got 1550-02-01"),
    ({"departure": {"epoch": "2026-04-31T00:00:00"}}, r"epoch: expected a calendar epoch, got 2026-04-31"),
    (
        {"departure": {"epoch": "2026-04-26T14:47:58Z"}},
        r"expected a TDB epoch .* without zone, got '2026.*Z'",
    ),
    (
        {"departure": {"kind": "orbit"}},
        r"problem\.departure: expected a table of kind 'state', 'spiral', got 'orbit'",
    ),
    ({"target": {"perilune_epoch": "1500-01-01T00:00:00"}}, r"perilune_epoch: .*inside the kernel .*1500"),
    ({"target": {"period_days": 5.0}}, r"problem\.target\.period_days: .*greater than 6, got 5\.0"),
    ({"target": {"kind": "spk", "path": "no.bsp", "naif_id": -1}}, r"expected an SPK file, got no\.bsp"),
    (
        {"bounds": {"initial_coast_days": [30.0, 0.0]}},
        r"initial_coast_days: expected lower < upper, got 30\.0 >",
    ),
    ({"bounds": {"shooting_days": [9.0, 9.0]}}, r"shooting_days: expected lower < upper, got 9\.0 >= 9\.0"),
    (
        {"bounds": {"final_coast_days": [-1.0, 9.0]}},
        r"final_coast_days: expected a lower bound >= 0, got -1\.0",
    ),
    ({"bounds": {"shooting_days": [0.0, 9.0]}}, r"shooting_days: expected a lower bound > 0, got 0\.0"),
    ({"bounds": {"throttle": [0.0, 1.5]}}, r"throttle: expected an upper bound <= 1, got 1\.5"),
    ({"bounds": {"min_final_mass_kg": 13277.0}}, r"min_final_mass_kg: expected less than .*, got 13277\.0"),
    ({"n_segments": 1}, r"problem\.n_segments: .*at least 2, got 1"),
    ({"n_segments": 50.0}, r"problem\.n_segments: .*integer, got 50\.0"),
    ({"segmentation": "random"}, r"problem\.segmentation: .*'adaptive' or 'uniform', got 'random'"),
    ({"thrust_n": 3.0}, r"problem\.thrust_n: expected one of spacecraft, .*, got unknown key 'thrust_n'"),
    (
        {"spacecraft": {"mass": 3.0}},
        r"problem\.spacecraft\.mass: expected one of wet_mass_kg, .*, got unknown key 'mass'",
    ),
]

OUTAGE_REFUSALS = [
    ([(0, 1.0)], r"problem\.outages\.0\.segment: .*at least 1, got 0"),
    ([(50, 1.0)], r"outages: expected a segment in 1\.\.49 .*, got 50"),
    ([(24, 0.0)], r"problem\.outages\.0\.duration_days: .*greater than 0, got 0\.0"),
    ([(24, 20.5)], r"outages: expected at most 20 days, got 20\.5; set bounds\.longest_outage_days"),
    ([(24, float("nan"))], r"problem\.outages\.0\.duration_days: .*, got nan"),
    ([(24, 1.0), (8, 1.0), (24, 1.0)], r"expected different outages, got segment 24 with 1\.0 days twice"),
]

#: One change to each field that describes the physics.
CHANGES = [
    {"spacecraft": {"wet_mass_kg": 15001.0}},
    {"spacecraft": {"dry_mass_kg": 5001.0}},
    {"spacecraft": {"max_thrust_n": 3.0000000000000004}},
    {"spacecraft": {"isp_s": 2709.0}},
    {"departure": {"epoch": "2026-04-26T14:47:59"}},
    {"departure": {"position_km": [-70200.0, -129008.0, -71568.0]}},
    {"departure": {"velocity_km_s": [1.5, -0.6, -0.3]}},
    {"departure": {"mass_kg": 13271.0}},
    {"target": {"period_days": 6.6}},
    {"target": {"perilune_epoch": "2026-05-01T00:00:00"}},
    {"bounds": {"shooting_days": [1e-3, 89.0]}},
    {"bounds": {"initial_coast_days": [0.0, 29.0]}},
    {"bounds": {"final_coast_days": [0.0, 29.0]}},
    {"bounds": {"throttle": [0.0, 0.9]}},
    {"bounds": {"min_final_mass_kg": 5000.0}},
    {"n_segments": 51},
    {"segmentation": "uniform"},
    {"outages": [{"segment": 24, "duration_days": 1.0}]},
]


def changed(change):
    return problem_from({"preset": "ppe-drm3"} | change)


@pytest.mark.parametrize(("change", "message"), REFUSALS)
def test_an_impossible_field_is_refused_with_its_name_value_and_reason(change, message):
    with pytest.raises(ProblemError, match=message):
        changed(change)


@pytest.mark.parametrize(("outages", "message"), OUTAGE_REFUSALS)
def test_an_impossible_outage_is_refused_with_its_name_value_and_reason(outages, message):
    with pytest.raises(ProblemError, match=message):
        PRESET.with_outages(outages)


@pytest.mark.parametrize("epoch", ["1550-02-16T00:00:00", "2649-05-20T00:00:00"])
def test_a_problem_near_an_end_of_the_kernel_has_its_target(epoch, tmp_path):
    target = {"period_days": 6.5623, "perilune_epoch": epoch}
    problem = changed({"departure": {"epoch": epoch}, "target": target})
    assert target_kernel(problem, tmp_path)[0].is_file()


def test_every_fault_of_a_problem_is_named_at_once():
    with pytest.raises(ProblemError) as caught:
        changed({"spacecraft": {"isp_s": -1.0, "max_thrust_n": -1.0}, "colour": "red"})
    lines = str(caught.value).splitlines()
    assert [line.split(":")[0] for line in lines] == [
        "problem.spacecraft.max_thrust_n",
        "problem.spacecraft.isp_s",
        "problem.colour",
    ]


@pytest.mark.parametrize("fields", [None, 3, "ppe-drm3", [1, 2]])
def test_what_is_no_table_of_fields_is_refused(fields):
    with pytest.raises(ProblemError, match="expected a table of fields, got"):
        problem_from(fields)


def test_an_unknown_preset_is_refused_with_the_known_ones():
    with pytest.raises(ProblemError, match=r"preset: expected one of earth-mars, ppe-drm3, got 'ppe'"):
        problem_from({"preset": "ppe"})
    with pytest.raises(
        ProblemError, match=r"expected a preset \(earth-mars, ppe-drm3\) or a readable file, got ppe: "
    ):
        load_problem("ppe")


def test_the_last_segment_but_one_may_be_missed():
    # One segment must remain to fly home with: 49 of 50 leaves it.
    assert PRESET.with_outages([(1, 20.0), (49, 1e-3)]).k == 2


def test_the_preset_states_the_published_spacecraft():
    craft = PRESET.spacecraft
    # Sinha and Beeson 2025: 15,000 kg wet, 10,000 kg of it propellant, 2e-4 m/s^2, 2,708 s.
    assert (craft.wet_mass_kg, craft.wet_mass_kg - craft.dry_mass_kg) == (15000.0, 10000.0)
    assert (craft.max_thrust_n / craft.wet_mass_kg, craft.isp_s) == (2e-4, 2708.0)
    assert presets() == ["earth-mars", "ppe-drm3"] and PRESET.departure.epoch == "2026-04-26T14:47:58"


def test_the_hash_does_not_depend_on_the_order_of_keys_or_outages():
    fields = WITH_TWO.model_dump(mode="json")
    backwards = dict(reversed([(key, value) for key, value in fields.items()]))
    backwards["spacecraft"] = dict(reversed(fields["spacecraft"].items()))
    backwards["outages"] = list(reversed(fields["outages"]))
    assert problem_from(backwards).hash == WITH_TWO.hash
    assert problem_from(backwards) == WITH_TWO


@pytest.mark.parametrize("change", CHANGES)
def test_any_physical_field_changes_the_hash(change):
    assert changed(change).hash != PRESET.hash


def test_problems_that_differ_in_outages_alone_are_one_family():
    assert WITH_TWO.family == PRESET.family == PRESET.hash
    assert WITH_TWO.hash != PRESET.hash
    assert changed({"n_segments": 51}).family != PRESET.family


def test_whole_numbers_and_floats_of_equal_value_hash_alike():
    assert changed({"spacecraft": {"isp_s": 2708}}).hash == PRESET.hash


def test_toml_and_json_with_the_same_fields_are_the_same_problem(tmp_path):
    text = 'preset = "ppe-drm3"\n[[outages]]\nsegment = 12\nduration_days = 1.0\n'
    (tmp_path / "p.toml").write_text(text)
    (tmp_path / "p.json").write_text(json.dumps(tomllib.loads(text)))
    assert load_problem(tmp_path / "p.toml") == load_problem(tmp_path / "p.json")
    (tmp_path / "all.json").write_text(WITH_TWO.model_dump_json())
    assert load_problem(tmp_path / "all.json").hash == WITH_TWO.hash


def test_the_problem_of_a_campaign_file_is_its_table_of_that_name(tmp_path):
    (tmp_path / "c.toml").write_text('rng_seed = 1\n[problem]\npreset = "ppe-drm3"\nn_segments = 20\n')
    assert load_problem(tmp_path / "c.toml").n_segments == 20


@pytest.mark.parametrize("content", [b"\xff\xfe\xfd", b"[[[", b"{"])
@pytest.mark.parametrize("name", ["p.toml", "p.json"])
def test_a_file_that_cannot_be_read_is_refused(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ProblemError, match=r"readable file, got .*p\."):
        load_problem(tmp_path / name)


def test_another_spk_file_with_the_same_content_is_the_same_problem(tmp_path):
    hashes = []
    for name, content in (("a.bsp", b"orbit"), ("b.bsp", b"orbit"), ("c.bsp", b"other")):
        (tmp_path / name).write_bytes(content)
        hashes.append(changed({"target": {"kind": "spk", "path": tmp_path / name, "naif_id": -1}}).hash)
    assert hashes[0] == hashes[1] != hashes[2]


@given(st.permutations([(4, 1.0), (12, 1.0), (12, 0.5), (48, 1.5), (26, 2.0)]))
@settings(max_examples=20, deadline=None, derandomize=True)
def test_outages_in_any_order_are_listed_by_segment_and_duration(outages):
    problem = PRESET.with_outages(outages)
    assert [(o.segment, o.duration_days) for o in problem.outages] == sorted(outages)


@given(st.datetimes(min_value=datetime(1550, 1, 1), max_value=datetime(2649, 1, 1)))
@settings(max_examples=50, deadline=None, derandomize=True)
def test_epochs_count_seconds_from_noon_of_the_first_of_january_2000(moment):
    expected = (moment - datetime(2000, 1, 1, 12)).total_seconds()
    # Two roundings of up to 1.4e10 s.
    assert seconds_past_j2000(moment.isoformat()) == pytest.approx(expected, abs=4e-6)


@given(st.datetimes(), st.sampled_from(("seconds", "milliseconds", "microseconds")))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_epochs_are_read_as_numpy_reads_them_to_the_bit(moment, form):
    text = moment.isoformat(timespec=form)
    microseconds = np.datetime64(text, "us") - np.datetime64("2000-01-01T12:00:00", "us")
    assert seconds_past_j2000(text) == microseconds / np.timedelta64(1, "us") * 1e-6


NO_DATES = ("2026-00-01", "2026-13-01", "2026-01-00", "2026-02-29", "2100-02-29")
NO_TIMES = ("24:00:00", "00:60:00", "00:00:60")


@pytest.mark.parametrize(
    "text", [*(f"{date}T00:00:00" for date in NO_DATES), *(f"2026-01-01T{time}" for time in NO_TIMES)]
)
def test_an_epoch_that_no_calendar_has_is_refused(text):
    with pytest.raises(ValueError, match=f"expected a calendar epoch, got {text}"):
        seconds_past_j2000(text)


def test_the_latest_arrival_counts_every_coast_and_the_longest_outage_of_any_problem():
    # T_i, T_s and T_f of 30, 90 and 30 d, T_i again after an outage, which may last 20 d.
    assert PRESET.latest_arrival_days == 30.0 + 90.0 + 30.0 + 30.0 + 20.0
    assert WITH_TWO.latest_arrival_days == PRESET.latest_arrival_days
    shorter = changed({"bounds": {"shooting_days": [1.0, 80.0]}})
    assert shorter.latest_arrival_days == 190.0
