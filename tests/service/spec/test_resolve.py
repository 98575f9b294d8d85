"""Problems that no spacecraft can fly: each refused with its field, its value and the likely slip."""

import json
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.ephemeris import body_table
from core.ephemeris.kernels import planetary_kernel
from core.ephemeris.spk import ChebyshevOrbit, write_orbit
from core.ephemeris.tables import coefficients_through, record_nodes, state_at
from core.epochs import seconds_past_j2000
from core.problem import ProblemError, load_problem, problem_from, require_physical
from core.ranges import FARTHEST_KM, FASTEST_KM_S, RANGES
from core.units import LU_KM
from service.spec import SpecError, load_spec
from service.spec.spec_check import require_flyable
from tests.core.test_world import on_circles
from tests.service.campaigns import SPIRAL, spec_fields

PRESET = load_problem("ppe-drm3")
POSITION, VELOCITY = PRESET.departure.position_km, PRESET.departure.velocity_km_s


def changed(**fields):
    return problem_from({"preset": "ppe-drm3"} | fields)


def metres(values):
    return [1e3 * value for value in values]


#: What was written, and what is said about it.
SLIPS = [
    (
        {"departure": {"position_km": metres(POSITION)}},
        r"departure\.position_km: .*, got 1\.63\d*e\+08; in metres",
    ),
    ({"departure": {"position_km": [1.47e8, 1e7, 0.0]}}, r"departure\.position_km: .*did you mean center"),
    ({"departure": {"position_km": [400.0, 0.0, 0.0]}}, r"expected 6378\.14 to 3e\+06 km .*, got 400; "),
    (
        {"departure": {"velocity_km_s": metres(VELOCITY)}},
        r"departure\.velocity_km_s: .*, got 1711\.\d*; in m/s",
    ),
    ({"departure": {"velocity_km_s": [5.0, 29.8, 0.0]}}, r"velocity_km_s: .*relative to the Sun\?"),
    ({"departure": SPIRAL | {"perigee_radius_km": 200.0}}, r"perigee_radius_km: .*, got 200; an altitude"),
    (
        {"departure": SPIRAL | {"apogee_radius_km": 6.7e6}},
        r"apogee_radius_km: .*, got 6\.7e\+06; an altitude",
    ),
    (
        {"spacecraft": {"isp_s": 2.0}},
        r"spacecraft\.isp_s: expected 10 to 100000 s, got 2; an exhaust velocity",
    ),
    ({"spacecraft": {"max_thrust_n": 3e6}}, r"max_thrust_n: expected 1e-08 to 100000 N, got 3e\+06; "),
    ({"spacecraft": {"wet_mass_kg": 2e7}}, r"wet_mass_kg: .* kg, got 2e\+07; in grams or tons\?"),
    ({"bounds": {"shooting_days": [1.0, 37000.0]}}, r"bounds: expected a latest arrival within 3000 days"),
]


@pytest.mark.parametrize(("fields", "message"), SLIPS)
def test_a_slip_of_a_unit_or_a_frame_is_named(fields, message):
    problem = changed(**fields)
    begun = time.thread_time()
    with pytest.raises(SpecError, match=message):
        require_flyable(problem)
    assert time.thread_time() - begun < 1.0


def test_all_slips_are_told_at_once_and_a_stored_definition_is_read_all_the_same():
    problem = changed(departure={"position_km": metres(POSITION), "velocity_km_s": metres(VELOCITY)})
    with pytest.raises(SpecError) as told:
        require_flyable(problem, "problem")
    assert [line.split(":")[0] for line in str(told.value).splitlines()] == [
        "problem.departure.position_km",
        "problem.departure.velocity_km_s",
    ]
    assert problem_from(problem.model_dump(mode="json")).hash == problem.hash


@pytest.mark.parametrize("name", ["spacecraft.dry_mass_kg", "bounds.min_final_mass_kg"])
def test_a_departure_without_propellant_is_refused(name):
    part, field = name.split(".")
    problem = changed(departure={"mass_kg": 4000.0}, spacecraft={"dry_mass_kg": 3000.0})
    least = problem.model_copy(update={part: getattr(problem, part).model_copy(update={field: 4500.0})})
    require_flyable(problem)
    with pytest.raises(SpecError, match=rf"departure: .* above {name} = 4500 kg, got 4000 kg; correct"):
        require_flyable(least)


def test_a_file_of_a_problem_is_checked_as_well(tmp_path):
    (tmp_path / "p.toml").write_text('preset = "ppe-drm3"\nspacecraft = { isp_s = 2.0 }\n')
    with pytest.raises(ProblemError, match=r"problem\.spacecraft\.isp_s: expected 10 to"):
        load_problem(tmp_path / "p.toml")


@pytest.mark.parametrize("naif_id", [301, 399, 10, 3])
def test_a_body_of_the_force_model_is_no_target(naif_id):
    target = {"kind": "spk", "path": str(planetary_kernel()), "naif_id": naif_id}
    with pytest.raises(SpecError, match=rf"target\.naif_id: expected .*, got {naif_id}, which is a body"):
        require_flyable(changed(target=target))


def kernel(path, radius_km):
    """Write an object at a fixed distance from the Moon."""
    start = seconds_past_j2000(PRESET.departure.epoch)
    nodes = record_nodes(0.0, 86400.0, 260, 24)
    places = np.zeros((*nodes.shape, 3))
    places[:, :, 0] = radius_km
    write_orbit(
        path, -90001, ChebyshevOrbit(start - 86400.0, 86400.0, coefficients_through(places)), "A point."
    )
    return changed(target={"kind": "spk", "path": str(path), "naif_id": -90001})


@pytest.mark.parametrize(
    ("radius_km", "message"),
    [
        (100.0, r"target: expected an orbit outside the Moon, radius 1737\.4 km, got 100 km"),
        (6e6, r"target: expected an orbit within 3e\+06 km of the Earth, got [56]\.\d*e\+06 km at 202"),
    ],
)
def test_a_target_through_a_body_or_far_away_is_refused(tmp_path, radius_km, message):
    with pytest.raises(SpecError, match=message):
        require_flyable(kernel(tmp_path / "t.bsp", radius_km))
    require_flyable(kernel(tmp_path / "good.bsp", 40000.0))


def test_a_departure_inside_the_moon_is_refused():
    moon = state_at(body_table(seconds_past_j2000(PRESET.departure.epoch), 0.0, 1.0), 0.0)[0, :3] * LU_KM
    inside = changed(departure={"position_km": np.add(moon, [1000.0, 0.0, 0.0]).tolist()})
    with pytest.raises(SpecError, match=r"departure: expected a state outside the Moon, .*, got 1000 km"):
        require_flyable(inside)


def test_a_spiral_that_takes_too_long_to_compute_is_given_up(monkeypatch):
    monkeypatch.setattr("service.spec.spec_check.MOST_CPU_S", 0.2)
    slow = SPIRAL | {"apogee_radius_km": 6578.0, "duration_days": 999.0}
    begun = time.thread_time()
    with pytest.raises(SpecError, match=r"within the time for its computation, got to \d+\.\d days"):
        require_flyable(changed(departure=slow, spacecraft={"max_thrust_n": 0.01}))
    # Compiling is not counted on.
    assert time.thread_time() - begun < 20.0


def test_a_spiral_ends_where_it_meets_the_earth():
    # A perigee on the surface and an apogee beyond the Moon, whose pull and the Sun's lower it.
    low = SPIRAL | {"perigee_radius_km": 6378.137, "apogee_radius_km": 900000.0, "duration_days": 300.0}
    with pytest.raises(SpecError, match=r"spiral: expected .* it meets the Earth"):
        require_flyable(changed(departure=low, spacecraft={"max_thrust_n": 1e-6}))


def in_range(low, high):
    return st.floats(low, high, allow_nan=False)


def value_of(field):
    return in_range(*next((low, high) for name, low, high, *_ in RANGES if name == field))


@st.composite
def problems(draw):
    wet = draw(value_of("spacecraft.wet_mass_kg"))
    vector = st.tuples(*[in_range(-1.0, 1.0)] * 3)
    start = draw(in_range(0.5, 1.0)) * wet
    craft = {"wet_mass_kg": wet, "dry_mass_kg": 0.4 * wet}
    craft |= {name: draw(value_of(f"spacecraft.{name}")) for name in ("max_thrust_n", "isp_s")}
    departure = {
        "kind": "state",
        "epoch": PRESET.departure.epoch,
        "position_km": [FARTHEST_KM["EARTH"] * part for part in draw(vector)],
        "velocity_km_s": [FASTEST_KM_S["EARTH"] * part for part in draw(vector)],
        "mass_kg": start,
    }
    bounds = {
        "shooting_days": [1.0, draw(in_range(1.0, 40.0))],
        "min_final_mass_kg": draw(in_range(1e-3, 1e7)),
    }
    return {"spacecraft": craft, "departure": departure, "bounds": bounds}


@given(problems())
@settings(max_examples=60, deadline=None, derandomize=True)
def test_any_problem_inside_the_ranges_is_taken_or_refused_in_one_line_for_each_fault(fields):
    begun = time.thread_time()
    try:
        require_flyable(problem_from(fields))
    except (ProblemError, SpecError) as error:
        assert all(": expected " in line and ", got " in line for line in str(error).splitlines())
    # The first makes the NRHO of this epoch, and compiles what is not compiled yet.
    assert time.thread_time() - begun < 120.0


ROOT = Path(__file__).parents[3]
SHIPPED = [
    path
    for pattern in ("examples/**/*.toml", "service/spec/templates/*.toml", "benchmark/*/*/problem.toml")
    for path in ROOT.glob(pattern)
]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_what_is_shipped_lies_inside_the_ranges(path):
    fields = tomllib.loads(path.read_text(encoding="utf-8"))
    fields = fields.get("problem", fields)
    # Files of targets lie elsewhere, or are made first.
    without = {name: value for name, value in fields.items() if name != "target"}
    require_physical(problem_from(without))


@pytest.mark.parametrize(
    "craft",
    [
        # A CubeSat of 4 kg with 50 micronewtons, and a tug of 400 tons with 2 kN.
        {"wet_mass_kg": 4.0, "dry_mass_kg": 3.0, "max_thrust_n": 5e-5, "isp_s": 5000.0},
        {"wet_mass_kg": 4e5, "dry_mass_kg": 1e5, "max_thrust_n": 2000.0, "isp_s": 8000.0},
    ],
)
def test_the_smallest_and_the_largest_spacecraft_are_taken(craft):
    start = craft["wet_mass_kg"]
    bounds = {"min_final_mass_kg": craft["dry_mass_kg"]}
    require_physical(changed(spacecraft=craft, departure={"mass_kg": start}, bounds=bounds))


def test_the_kernel_of_a_world_is_looked_for_beside_its_file_and_checked(tmp_path):
    problem, file = on_circles(tmp_path) | {"n_segments": 30}, tmp_path / "spec.json"
    problem["world"]["kernel"], problem["target"]["path"] = "moon.bsp", "target.bsp"
    file.write_text(json.dumps(spec_fields(problem=problem)))
    require_flyable(load_spec(file).problem)
    on_circles(tmp_path, radius_km=3.844e8)
    with pytest.raises(SpecError, match=r"^spec\.problem: world\.kernel \S+: .* in metres or other units\?$"):
        require_flyable(load_spec(file).problem)
    (tmp_path / "moon.bsp").unlink()
    with pytest.raises(
        SpecError, match=r"^spec\.problem\.world\.kernel: expected an SPK file, got \S+, which"
    ):
        load_spec(file)
