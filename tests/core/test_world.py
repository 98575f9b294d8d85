"""Problems about the Sun and of other masses: units, force model, partials, solutions and what is refused."""

import numpy as np
import pytest
import spiceypy

import core
from core.dynamics import force_model
from core.ephemeris import body_table, state_at
from core.ephemeris.kernels import furnish
from core.epochs import seconds_past_j2000
from core.orbits.clearance import ClearanceError, check_clearance
from core.problem import ProblemError, load_problem, problem_from, require_physical
from core.transcription import Transcription
from core.world import BODIES, EARTH, USUAL, world_of
from tests.core.partials import assert_partials

MARS = load_problem("earth-mars")
#: A state on a distant retrograde orbit, and a spacecraft that thrusts with 1e-4 m/s^2 whatever it weighs.
CUBESAT = {
    "n_segments": 20,
    "departure": {
        "epoch": "2026-05-10T00:00:00",
        "position_km": [247243.3814840948, -185128.6534091492, -88340.8228307213],
        "velocity_km_s": [0.8102380914962765, 0.917591342691877, 0.5222576376875369],
    },
    "bounds": {"shooting_days": [1.0, 120.0], "initial_coast_days": [0.0, 15.0]},
}


def cubesat(mass_kg):
    craft = {"wet_mass_kg": mass_kg, "dry_mass_kg": 0.75 * mass_kg, "max_thrust_n": 1e-4 * mass_kg}
    return problem_from(
        CUBESAT
        | {
            "spacecraft": craft | {"isp_s": 1600.0},
            "departure": CUBESAT["departure"] | {"kind": "state", "mass_kg": mass_kg},
            "bounds": CUBESAT["bounds"] | {"min_final_mass_kg": 0.75 * mass_kg},
        }
    )


def perturbed():
    """Return the transfer to Mars with all the bodies that a force model has room for, and an outage."""
    names = ["VENUS BARYCENTER", "EARTH BARYCENTER", "JUPITER BARYCENTER"]
    fields = MARS.model_dump(mode="json") | {"world": {"center": "SUN", "bodies": names}, "n_segments": 9}
    # The Earth would pull without bound where a spacecraft leaves it.
    moved = [1.02 * component for component in MARS.departure.position_km]
    fields["departure"]["position_km"] = moved
    return problem_from(fields | {"outages": [{"segment": 4, "duration_days": 28.0}]})


def random_point(flown, rng_seed):
    lower, upper = flown.bounds
    x = lower + (upper - lower) * np.random.default_rng(rng_seed).random(len(lower))
    for trajectory in flown.layout.trajectories:
        x[trajectory.final_mass] = 0.8 * flown.start_mass_kg
    return x


def test_the_usual_world_is_no_field_and_has_one_hash():
    preset = load_problem("ppe-drm3")
    for world in ({}, {"center": "EARTH"}, {"bodies": list(USUAL["EARTH"])}):
        written = problem_from({"preset": "ppe-drm3", "world": world})
        assert written == preset and written.hash == preset.hash
        assert (
            "world" not in written.model_dump()
            and "longest_outage_days" not in written.model_dump()["bounds"]
        )
    assert problem_from({"preset": "ppe-drm3", "bounds": {"longest_outage_days": 30.0}}).hash != preset.hash
    assert problem_from(MARS.model_dump(mode="json")) == MARS


def test_the_units_of_each_world():
    sun, preset = world_of(MARS).units, world_of(load_problem("ppe-drm3"))
    assert sun.gm(BODIES["SUN"].gm_km3_s2) == pytest.approx(1.0, rel=1e-12)
    assert sun.tu_days == pytest.approx(58.13244, rel=1e-6) and sun.mu_kg == 1500.0
    assert preset == EARTH and (preset.strict.mass_kg, preset.loose.mass_kg) == (0.01, 1.0)
    assert world_of(MARS).strict.position_km == 10.0 and world_of(MARS).loose.position_km == 1000.0
    assert world_of(cubesat(12.0)).strict.mass_kg == pytest.approx(8e-6)


def test_bodies_about_the_sun_are_where_spice_has_them():
    furnish()
    world, origin = world_of(perturbed()), seconds_past_j2000(MARS.departure.epoch)
    table = body_table(origin, 0.0, 800.0, is_fine=True, world=world)
    for days in np.random.default_rng(1).uniform(0.0, 800.0, 50):
        place, rate, _ = state_at(table, days)
        for number, body in enumerate(world.bodies):
            expected = spiceypy.spkezr(body.name, origin + 86400.0 * days, "J2000", "NONE", "SUN")[0]
            own = slice(3 * number, 3 * number + 3)
            # Venus turns by 0.06 rad in a record of two days: degree 7 leaves (0.03)^8 / 8! of its orbit, a
            # micrometre; SPICE's epochs, spaced by 1e-7 s, are off by 4e-6 km.
            np.testing.assert_allclose(place[own] * world.units.lu_km, expected[:3], rtol=0, atol=2e-4)
            np.testing.assert_allclose(rate[own] * world.units.vu_km_s, expected[3:], rtol=0, atol=1e-7)


def test_a_world_without_bodies_is_keplers():
    world = world_of(MARS)
    model = force_model(MARS, body_table(0.0, 0.0, 30.0, world=world))
    assert model.gm.tolist()[1:] == [0.0, 0.0, 0.0] and not model.field.coefficients.any()


@pytest.mark.parametrize("rng_seed", [1, 2])
def test_every_column_of_the_jacobian_is_a_central_difference_about_the_sun(rng_seed):
    flown = Transcription(perturbed(), 1, 1e-13)
    units = np.tile(flown.state_scale, flown.n_defects // 7)
    x = random_point(flown, rng_seed)
    assert_partials(
        flown.jacobian(x).toarray() / units[:, None] * flown.scale,
        lambda z: flown.defects(z * flown.scale) / units,
        x / flown.scale,
        step=1e-4,
        # Ten revolutions magnify the integrator's 1e-13 a thousandfold, over h; h^4 is less.
        atol=2e-6,
        rtol=1e-6,
        order=4,
    )


def test_the_verifier_finds_the_defects_that_the_solver_sees_about_the_sun():
    problem = perturbed()
    flown = Transcription(problem, 1, 1e-13)
    x = random_point(flown, 3)
    found = core.verify(problem, x).defects
    # Both integrate to 1e-13 of 2e8 km, over a revolution that magnifies it a hundredfold.
    np.testing.assert_allclose(found[:, :3], flown.defects(x).reshape(-1, 7)[:, :3], rtol=0, atol=0.05)
    np.testing.assert_allclose(found[:, 3:6], flown.defects(x).reshape(-1, 7)[:, 3:6], rtol=0, atol=1e-8)


def test_mars_is_reached_from_a_uniform_guess_and_survives_outages():
    transcription = core.transcribe(MARS)
    guess = core.sample_guess(transcription, np.random.default_rng(1))
    found = core.solve(transcription, guess)
    checked = core.verify(MARS, found.x)
    assert checked.strict and found.objective > 1202.9
    assert [approach.body for approach in checked.closest[0]] == ["Sun"]
    robust = MARS.with_outages([(8, 28.0), (20, 28.0), (32, 28.0)])
    recovered = core.search.solve_seed(MARS, found.x, robust, "reference")
    assert core.verify(robust, recovered.x).strict


def test_the_same_problem_at_another_mass_has_the_same_defects():
    flown = [Transcription(cubesat(mass)) for mass in (12.0, 120.0, 1.2e3, 1.2e4)]
    z = random_point(flown[0], 4) / flown[0].scale
    defects = [one.evaluate(one.plain, z, with_partials=False)[0] for one in flown]
    for other in defects[1:]:
        # A last bit of thrust over mass may change a step, and so an error of 3e-10, which is magnified here.
        np.testing.assert_allclose(other, defects[0], rtol=0, atol=1e-7)


def test_an_outage_is_as_long_as_the_bounds_allow():
    assert MARS.with_outages([(5, 60.0)]).k == 1
    with pytest.raises(ProblemError, match=r"outages: expected at most 60 days, got 61; set bounds\.longest"):
        MARS.with_outages([(5, 61.0)])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"world": {"center": "SUN", "bodies": ["VULCAN"]}}, "expected some of SUN, .*, got VULCAN"),
        ({"world": {"center": "SUN", "bodies": ["SUN"]}}, "expected each once, and not the centre, got SUN"),
        (
            {"world": {"center": "SUN", "gm_km3_s2": [1.0, 2.0]}},
            "expected 1 numbers, the centre's first, got 2",
        ),
        ({"world": {"center": "MARS"}}, "center: .*, got 'MARS'"),
        ({"target": {"kind": "nrho"}}, "expected an object of a kernel, got an NRHO"),
    ],
)
def test_a_world_that_cannot_be_is_refused_in_one_line(change, message):
    with pytest.raises(ProblemError, match=message) as refused:
        problem_from({"preset": "earth-mars"} | change)
    assert "\n" not in str(refused.value)


def test_a_target_that_pulls_and_a_centre_that_does_not_fit_are_refused():
    pulled = problem_from({"preset": "earth-mars", "world": {"bodies": ["MARS BARYCENTER"]}})
    with pytest.raises(ProblemError, match=r"naif_id: expected .* that does not pull here, got 4"):
        require_physical(pulled)
    fields = MARS.model_dump(mode="json")
    del fields["world"]
    with pytest.raises(ProblemError, match=r"position_km: .*, got 1\.5.*; .*did you mean center"):
        require_physical(problem_from(fields))
    near = load_problem("ppe-drm3").departure.model_dump()
    with pytest.raises(ProblemError, match=r"from the Sun's centre, got .*; in AU, or relative to the Earth"):
        require_physical(problem_from({"preset": "earth-mars", "departure": near | {"mass_kg": 1500.0}}))


def test_an_object_about_the_sun_is_no_target_near_the_earth():
    fields = cubesat(1.2e3).model_dump(mode="json") | {"target": MARS.target.model_dump(mode="json")}
    with pytest.raises(ClearanceError, match=r'of the Earth, got .*; did you mean center = "SUN"'):
        check_clearance(problem_from(fields))
    check_clearance(MARS)
