"""Problems about the Sun and of other masses: units, force model, partials, solutions and what is refused."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import spiceypy

import core
from core.analysis.flight import fly
from core.dynamics import force_model
from core.ephemeris import body_table, state_at
from core.ephemeris.daf import SpkError
from core.ephemeris.kernels import furnish, loaded
from core.ephemeris.spk import ChebyshevOrbit, new_spk, write_orbit
from core.ephemeris.tables import coefficients_through, record_nodes
from core.epochs import seconds_past_j2000
from core.orbits import target_kernel
from core.orbits.clearance import ClearanceError, check_clearance
from core.problem import ProblemError, load_problem, problem_from, require_physical
from core.transcription import Transcription
from core.verification.certificate import certify
from core.verification.end_to_end import apart
from core.world import AU_KM, BODIES, EARTH, USUAL, world_of
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


SPIRAL = {
    "kind": "spiral",
    "epoch": "2028-09-01T00:00:00",
    "perigee_radius_km": 7e3,
    "apogee_radius_km": 7e3,
    "inclination_deg": 28.0,
    "raan_deg": 0.0,
    "argument_of_perigee_deg": 0.0,
    "jacobi": 3.3,
}
#: Departure of the CubeSat, and how long its bodies are known at least [TDB s past J2000].
SPAN = tuple(seconds_past_j2000(CUBESAT["departure"]["epoch"]) + 86400.0 * days for days in (0.0, 200.0))


def circle(et, radius_km, period_days):
    """Return positions and velocities (n, 6) on a circle [km, km/s]."""
    rate = 2 * np.pi / (86400.0 * period_days)
    cosine, sine, zero = np.cos(rate * (et - SPAN[0])), np.sin(rate * (et - SPAN[0])), 0.0 * et
    return radius_km * np.stack([cosine, sine, zero, -rate * sine, rate * cosine, zero], axis=-1)


def on_circle(
    path, body=301, center=399, span=SPAN, radius_km=384400.0, period_days=27.3, frame="J2000", change=None
):
    """Write a body on a circle as a kernel; `change` spoils its states."""
    et = np.append(np.arange(span[0], span[1] - 1.0, 10800.0), span[1])
    states = circle(et, radius_km, period_days)
    if change is not None:
        change(states)
    with new_spk(path, "a circle") as handle:
        spiceypy.spkw13(handle, body, center, frame, *span, "circle", 7, len(et), states, et)
    return path


def on_circles(folder, **kernel):
    """Return the CubeSat's problem where the Moon alone pulls, on a circle, to a circle about the Moon."""
    moon, target = folder / "moon.bsp", folder / "target.bsp"
    on_circle(moon, **kernel)
    on_circle(target, body=-77, center=301, radius_km=5e4, period_days=10.0)
    fields = cubesat(1.2e3).model_dump(mode="json") | {"world": {"bodies": ["MOON"], "kernel": str(moon)}}
    fields["departure"] |= {"position_km": [0.0, 2.5e5, 0.0], "velocity_km_s": [-1.2, 0.0, 0.1]}
    return fields | {"target": {"kind": "spk", "path": str(target), "naif_id": -77}}


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


@pytest.mark.parametrize("problem", [perturbed(), cubesat(12.0)], ids=["sun", "cubesat"])
def test_every_column_of_the_hessian_is_a_central_difference(problem):
    flown = Transcription(problem, 6, 1e-13)
    x = random_point(flown, 2)
    # So short that no leg magnifies differences more than a hundredfold.
    for trajectory in flown.layout.trajectories:
        x[trajectory.shooting_time] *= 0.3
    structure, z = flown.lifted, flown.lift(x)
    weights = np.random.default_rng(2).normal(size=7 * len(structure.plan.block_plus))
    lower = np.zeros((structure.n_variables, structure.n_variables))
    values = flown.hessian(structure, z, weights)
    np.add.at(lower, (structure.hessian_rows, structure.hessian_columns), values)

    def gradient(z):
        _, partials = flown.evaluate(structure, z, with_partials=True)
        return np.bincount(structure.columns, partials * weights[structure.rows], structure.n_variables)

    # The Jacobian is known to 1e-10 where a leg is a revolution: 1e-6 over h; h^4 leaves 1e-6 of a column.
    symmetric = lower + np.tril(lower, -1).T
    assert_partials(symmetric, gradient, z, step=1e-4, atol=1e-5, rtol=1e-6, order=4)


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
            "expected 1 numbers, the centre's first, got 2; give one for each of SUN",
        ),
        ({"world": {"center": "MARS"}}, "center: .*, got 'MARS'"),
        ({"world": {"bodies": ["JUPTER BARYCENTER"]}}, r"got JUPTER B.*; did you mean JUPITER BARYCENTER\?"),
        ({"world": {"bodies": ["mars"]}}, r"got mars; did you mean MARS BARYCENTER\?"),
        (
            {"world": {"bodies": ["VENUS", "VENUS"]}},
            "expected each once, .*, got VENUS, which is there already",
        ),
        (
            {"world": {"bodies": ["EARTH", "EARTH BARYCENTER"]}},
            "got EARTH BARYCENTER and EARTH, .*; leave out",
        ),
        (
            {"world": {"bodies": ["VENUS", "VENUS BARYCENTER"]}},
            "got VENUS BARYCENTER and VENUS, .*; leave out",
        ),
        ({"world": {"bodies": ["VENUS", "EARTH", "MOON", "MERCURY"]}}, "expected at most 3 items, got 4"),
        ({"world": {"bodies": "VENUS"}}, r"world\.bodies: expected a list, got 'VENUS'"),
        (
            {"world": {"bodys": []}},
            r"world\.bodys: expected one of center, bodies, .*, got unknown key 'bodys'",
        ),
        ({"world": "SUN"}, r"world: expected a table, got 'SUN'"),
        ({"world": {"kernel": "moon.bsp"}}, "kernel: expected bodies whose places it gives, got none; name"),
        ({"world": {"digest": 32 * "0"}}, "digest: expected none without a kernel"),
        ({"world": {"gm_km3_s2": [float("nan")]}}, r"gm_km3_s2\.0: expected a finite number, got nan"),
        ({"world": {"gm_km3_s2": [-1.0]}}, r"gm_km3_s2\.0: expected a number greater than 0, got -1"),
        (
            {"world": {"bodies": ["MOON"], "kernel": "nowhere.bsp"}},
            r"world\.kernel: .*, got nowhere\.bsp, which",
        ),
        ({"bounds": {"longest_outage_days": 1e4}}, "longest_outage_days: expected a number of at most 1000"),
        (
            {"departure": SPIRAL},
            "expected a state, got a spiral, which is made in the usual world of the Earth alone; leave out",
        ),
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
    with pytest.raises(ProblemError, match=r"position_km: .*, got 1\.5.*; .*did you mean center") as refused:
        require_physical(problem_from(fields))
    assert "\n" not in str(refused.value)
    near = load_problem("ppe-drm3").departure.model_dump()
    with pytest.raises(ProblemError, match=r"the Sun's centre, got .*; in AU, or .* center = .EARTH"):
        require_physical(problem_from({"preset": "earth-mars", "departure": near | {"mass_kg": 1500.0}}))


def test_an_object_about_the_sun_is_no_target_near_the_earth():
    fields = cubesat(1.2e3).model_dump(mode="json") | {"target": MARS.target.model_dump(mode="json")}
    with pytest.raises(ClearanceError, match=r'of the Earth, got .*; did you mean center = "SUN"'):
        check_clearance(problem_from(fields))
    check_clearance(MARS)


@pytest.mark.parametrize(
    ("world", "message"),
    [
        (
            {"bodies": ["EARTH BARYCENTER"]},
            r"departure: expected a state at least .* from EARTH BARYCENTER, .*",
        ),
        ({"bodies": ["EARTH"]}, r"departure: .* outside the Earth, .*, or one body less in world\.bodies\?"),
    ],
)
def test_a_departure_at_a_body_that_pulls_is_refused(world, message):
    with pytest.raises(ClearanceError, match=message):
        check_clearance(problem_from({"preset": "earth-mars", "world": world}))


@pytest.mark.parametrize("gm", [1.3e20, 0.9])
def test_a_gravitational_parameter_of_another_unit_is_refused(gm):
    with pytest.raises(
        ProblemError, match=r"world\.gm_km3_s2: expected 1\.327e\+08 to .* for SUN, got .*m\^3"
    ):
        require_physical(problem_from({"preset": "earth-mars", "world": {"gm_km3_s2": [gm]}}))


# A world with a kernel.


def spoiled(row, column, value):
    def change(states):
        states[row, column] = value

    return change


@pytest.mark.parametrize(
    ("kernel", "message"),
    [
        ({"body": -5}, r"expected MOON \(301\) relative to EARTH \(399\), got -5 relative to 399; write it"),
        ({"center": 3}, r"expected MOON \(301\) relative to EARTH \(399\), got 301 relative to 3; write it"),
        (
            {"span": (SPAN[0], SPAN[0] + 864e4)},
            r".* from the departure .*, got 2026-05-10.*\.\.2026-08-18.*; make",
        ),
        (
            {"span": (SPAN[0] + 1.0, SPAN[1])},
            r".* to the latest arrival, .*, got 2026-05-10T00:00:01.*; make it",
        ),
        ({"change": spoiled(50, 1, np.nan)}, "expected finite numbers for 301, got NaN or infinity; make it"),
        ({"change": spoiled(50, 4, np.inf)}, "expected finite numbers for 301, got NaN or infinity; make it"),
        ({"change": spoiled(slice(None), slice(3), 0.0)}, r"expected MOON 3.* km from the centre, got 0 km"),
        (
            {"radius_km": 3.844e8},
            r"expected MOON 3.* to 3.* km from the centre, got 3\.84e\+08 km at .*; in metres",
        ),
        (
            {"change": spoiled(slice(50, None), 0, 3e5)},
            r"expected MOON on a path that is smooth to 0\.1 km over",
        ),
        (
            {"period_days": 0.5},
            r"expected MOON on a path that is smooth to 0\.1 km over 0\.5 days, got 1.* km",
        ),
        (
            {"frame": "IAU_EARTH"},
            "expected 301 in a frame that is built into SPICE, like J2000, got frame 10013",
        ),
    ],
)
def test_a_kernel_that_cannot_place_the_bodies_is_refused_in_one_line(kernel, message, tmp_path):
    problem = problem_from(on_circles(tmp_path, **kernel))
    with pytest.raises(SpkError, match=r"^world\.kernel \S+/moon\.bsp: " + message) as refused:
        target_kernel(problem)
    assert "\n" not in str(refused.value)


def test_a_target_in_the_kernel_of_the_world_is_refused(tmp_path):
    fields = on_circles(tmp_path)
    with new_spk(tmp_path / "moon.bsp", "both") as handle:
        et = np.append(np.arange(SPAN[0], SPAN[1] - 1.0, 10800.0), SPAN[1])
        for body in (301, -77):
            states = circle(et, 384400.0, 27.3)
            spiceypy.spkw13(handle, body, 399, "J2000", *SPAN, "circle", 7, len(et), states, et)
    with pytest.raises(SpkError, match=r"got the target -77 among them, which comes from its own file; take"):
        target_kernel(problem_from(fields))


def test_a_path_that_is_no_text_is_shown_escaped_and_in_short():
    for name, shown in (("\0.bsp", r"'\\x00\.bsp'"), ("x" * 5000, r"'x{79}\.\.\.")):
        with pytest.raises(
            ProblemError, match=rf"^problem\.world\.kernel: expected an SPK file, got {shown}"
        ):
            problem_from({"preset": "earth-mars", "world": {"bodies": ["VENUS"], "kernel": name}})


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_kernel_that_is_none_or_cut_off_is_refused(share, tmp_path):
    fields = on_circles(tmp_path)
    content = (tmp_path / "moon.bsp").read_bytes()
    (tmp_path / "moon.bsp").write_bytes(content[: int(share * len(content))])
    with pytest.raises(SpkError, match=r"^world\.kernel \S+: expected (an|a whole) SPK kernel.*, got "):
        target_kernel(problem_from(fields))


def test_a_kernel_that_was_changed_since_is_refused(tmp_path):
    problem = problem_from(on_circles(tmp_path))
    with (tmp_path / "moon.bsp").open("ab") as stream:
        stream.write(bytes(8))
    with pytest.raises(SpkError, match=r"^world\.kernel \S+: expected the file with digest .*changed since$"):
        target_kernel(problem)
    with pytest.raises(ProblemError, match=r"^problem\.world\.kernel: .*; the file has been changed since$"):
        problem_from(problem.model_dump(mode="json"))


def test_a_kernel_as_long_as_the_problem_is_long_enough(tmp_path):
    shortest = cubesat(1.2e3).latest_arrival_days
    problem = problem_from(on_circles(tmp_path, span=(SPAN[0], SPAN[0] + 86400.0 * shortest)))
    check_clearance(problem)
    transcription = core.transcribe(problem)
    assert np.all(np.isfinite(transcription.setting.model.bodies.coefficients))
    verified = core.verify(problem, random_point(transcription, 5))
    assert verified.kernels[2] == ("moon.bsp", problem.world.digest)


def test_bodies_of_a_kernel_are_those_of_its_own_world_alone(tmp_path):
    def table(problem):
        return body_table(SPAN[0], 0.0, 30.0, is_fine=True, world=world_of(problem)).coefficients

    folders = [tmp_path / name for name in ("near", "far")]
    for folder in folders:
        folder.mkdir()
    own = [problem_from(on_circles(f, radius_km=r)) for f, r in zip(folders, (3e5, 4e5), strict=True)]
    problems = [*own, cubesat(1.2e3)] * 4
    before = [table(problem) for problem in problems[:3]]
    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(table, problems))
    for place, one in enumerate(found):
        np.testing.assert_array_equal(one, before[place % 3])
    # The sum of Chebyshev coefficients is the value at the end of a record.
    first = before[0][0, :, :3].sum(axis=0) * world_of(own[0]).units.lu_km
    assert np.linalg.norm(first) == pytest.approx(3e5)

    def defects(problem):
        return core.verify(problem, random_point(core.transcribe(problem), 5)).defects

    one_by_one = [defects(problem) for problem in problems[:3]]
    with ThreadPoolExecutor(6) as pool:
        # As in a service, where figures are drawn while solutions are verified.
        verified, drawn = pool.map(defects, problems[:3]), pool.map(table, problems)
        np.testing.assert_array_equal(list(verified), one_by_one)
        assert len(list(drawn)) == len(problems)
    moon = spiceypy.spkgps(301, SPAN[0], "J2000", 399)[0]
    with loaded(own[0].world.kernel):
        assert np.linalg.norm(spiceypy.spkgps(301, SPAN[0], "J2000", 399)[0]) == pytest.approx(3e5)
    np.testing.assert_array_equal(spiceypy.spkgps(301, SPAN[0], "J2000", 399)[0], moon)


@pytest.mark.parametrize("problem", [MARS, perturbed()], ids=["alone", "perturbed"])
def test_frames_far_from_the_moon_are_about_the_target(problem):
    furnish()
    flown = fly(problem, random_point(core.transcribe(problem), 6))
    assert flown.main == "Mars"
    origin = seconds_past_j2000(problem.departure.epoch)
    reference = flown.trajectories[0]
    for days, place, turned in zip(reference.days, reference.moon_km, flown.moon.rotating_km, strict=False):
        expected = spiceypy.spkpos("4", origin + 86400.0 * days, "J2000", "NONE", "SUN")[0]
        # The table of Mars is exact to metres; SPICE's epochs, spaced by 1e-7 s, to 3 mm.
        np.testing.assert_allclose(place, expected, rtol=0, atol=0.1)
        np.testing.assert_allclose(turned, [AU_KM, 0.0, 0.0], rtol=0, atol=1e-3)


def test_heyoka_agrees_about_the_sun_alone():
    pytest.importorskip("heyoka", reason="heyoka is an extra: pip install -c constraints.txt -e '.[heyoka]'")
    transcription = core.transcribe(MARS)
    found = core.solve(transcription, core.sample_guess(transcription, np.random.default_rng(1)))
    certificate = certify(MARS, found.x, with_heyoka=True)
    position, velocity = apart(certificate.third.flights[0], certificate.trajectories[0].through)
    # A revolution of 2e8 km magnifies the 1e-13 of a step a hundredfold: two metres.
    assert certificate.is_sound and position < 0.1 and velocity < 1e-7


def test_heyoka_flies_by_the_records_of_a_kernel(tmp_path):
    pytest.importorskip("heyoka", reason="heyoka is an extra: pip install -c constraints.txt -e '.[heyoka]'")
    fields = on_circles(tmp_path)
    nodes = record_nodes(SPAN[0], 86400.0, 200, 16)
    places = circle(nodes.ravel(), 384400.0, 27.3)[:, :3].reshape(200, 16, 3)
    orbit = ChebyshevOrbit(SPAN[0], 86400.0, coefficients_through(places))
    write_orbit(tmp_path / "moon.bsp", 301, orbit, "a circle", 399)
    problem = problem_from(fields)
    x = random_point(core.transcribe(problem), 5)
    found = certify(problem, x, with_heyoka=True)
    position, velocity = apart(found.third.flights[0], found.trajectories[0].through)
    # SciPy's 1e-13 a step, grown by a hundred days near Earth and Moon.
    assert position < 0.1 and velocity < 1e-5 and found.third.flights[0].failure == ""
    with pytest.raises(SpkError, match=r"expected Chebyshev records .*, got 1 segments of type 13 in"):
        on_circle(tmp_path / "moon.bsp")
        certify(problem_from(fields), x, with_heyoka=True)
