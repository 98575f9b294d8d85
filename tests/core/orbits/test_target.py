"""The target as SPK and as table: read through SPICE, flown by SciPy, and refused where it must be."""

import multiprocessing
import threading
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import spiceypy
from scipy.integrate import solve_ivp

from core.constants import GM_EARTH, GM_JUPITER, GM_MOON, GM_SUN, SECONDS_PER_DAY
from core.ephemeris import body_table, furnish, state_at
from core.ephemeris.daf import SpkError
from core.ephemeris.spk import read_orbit
from core.epochs import seconds_past_j2000
from core.orbits import target
from core.orbits.target import NRHO_WINDOW_DAYS, target_kernel, target_table
from core.problem import load_problem, problem_from
from core.units import LU_KM, TU_DAYS, VU_KM_S
from core.world import USUAL

PROBLEM = load_problem("ppe-drm3")
DEPARTURE_ET = seconds_past_j2000(PROBLEM.departure.epoch)


@pytest.fixture(scope="module")
def kernel(tmp_path_factory):
    path, naif_id = target_kernel(PROBLEM, tmp_path_factory.mktemp("kernels"))
    furnish(path)
    return path, naif_id


def from_moon(naif_id, days):
    return spiceypy.spkgeo(naif_id, DEPARTURE_ET + days * SECONDS_PER_DAY, "J2000", 301)[0]


def radii(naif_id, step_days=0.01):
    days = np.arange(NRHO_WINDOW_DAYS[0] + step_days, NRHO_WINDOW_DAYS[1] - step_days, step_days)
    return days, np.array([np.linalg.norm(from_moon(naif_id, day)[:3]) for day in days])


def extrema(days, radius, sign):
    """Return epochs and radii of the minima (sign 1) or maxima (-1), by parabolas through three samples."""
    found = []
    for i in np.flatnonzero((np.diff(sign * radius[:-1]) < 0) & (np.diff(sign * radius[1:]) > 0)) + 1:
        a, b, c = np.polyfit(days[i - 1 : i + 2] - days[i], radius[i - 1 : i + 2], 2)
        found.append((days[i] - b / (2 * a), c - b * b / (4 * a)))
    return np.array(found).T


def test_perilunes_apolunes_and_period_are_those_of_the_public_nrho(kernel):
    days, radius = radii(kernel[1])
    perilunes, low = extrema(days, radius, 1.0)
    _, high = extrema(days, radius, -1.0)
    # Lee's white paper on the 15-year reference: 3196-3557 km, mean 3366 km, mean period 6.562 d.
    assert 3196 < low.min() and low.max() < 3557
    assert low.mean() == pytest.approx(3366, abs=20)  # 31 perilunes, not 800, scattered by 70 km
    assert np.diff(perilunes).mean() == pytest.approx(6.562, abs=0.01)  # one shift of 0.3 d over 30 periods
    assert len(low) == 31 and high.min() > 69500 and high.max() < 72500  # the paper's "about 71,000 km"


def test_perilunes_keep_the_phase_over_the_whole_window(kernel):
    perilunes, _ = extrema(*radii(kernel[1]), 1.0)
    goal = (seconds_past_j2000("2026-04-30T00:00:00") - DEPARTURE_ET) / SECONDS_PER_DAY
    revolutions = np.round((perilunes - goal) / 6.5623)
    assert 0 in revolutions
    assert np.abs(perilunes - goal - 6.5623 * revolutions).max() < 0.3  # the Moon's eccentricity


def test_nrho_is_ballistic_under_spice_and_scipy(kernel):
    def rates(t, y):
        total = -GM_EARTH * y[:3] / np.linalg.norm(y[:3]) ** 3
        for body, gm in zip(USUAL["EARTH"], (GM_MOON, GM_SUN, GM_JUPITER), strict=True):
            place = spiceypy.spkpos(body, t, "J2000", "NONE", "EARTH")[0]
            away = place - y[:3]
            total += gm * (away / np.linalg.norm(away) ** 3 - place / np.linalg.norm(place) ** 3)
        return np.concatenate([y[3:], total])

    _, naif_id = kernel
    for start in np.random.default_rng(92).uniform(-5.0, 193.0, 4):
        ends = DEPARTURE_ET + np.array([start, start + 6.5]) * SECONDS_PER_DAY
        begin, expected = (spiceypy.spkgeo(naif_id, et, "J2000", 399)[0] for et in ends)
        end = solve_ivp(rates, ends, begin, method="DOP853", rtol=1e-13, atol=1e-10).y[:, -1]
        # The tables' Moon is 2e-7 km off, epochs 1e-7 s; a perilune on the way magnifies both 5e3 times.
        assert np.linalg.norm(end[:3] - expected[:3]) < 2e-3
        assert np.linalg.norm(end[3:] - expected[3:]) < 2e-8


def test_table_and_kernel_agree(kernel):
    table = target_table(PROBLEM, kernel[0].parent)
    for days in np.random.default_rng(1).uniform(*NRHO_WINDOW_DAYS, 300):
        value, rate, _ = state_at(table, days)
        expected = from_moon(kernel[1], days)
        # SPICE's epochs are spaced by 1.2e-7 s: 2e-7 km at perilune, and 5e-11 km/s.
        np.testing.assert_allclose(value * LU_KM, expected[:3], rtol=0, atol=1e-6)
        np.testing.assert_allclose(rate * VU_KM_S, expected[3:], rtol=0, atol=1e-9)


def test_derivatives_of_the_table_are_exact(kernel):
    table, h = target_table(PROBLEM, kernel[0].parent), 1e-5
    for t in np.random.default_rng(2).uniform(0.0, 40.0, 100):
        before, after = (state_at(table, (t + step) * TU_DAYS)[:2] for step in (-h, h))
        # Central difference: h^2/6 times the third derivative, up to 1e6 at perilune; rounding 1e-16 / h.
        np.testing.assert_allclose(
            (after - before) / (2 * h), state_at(table, t * TU_DAYS)[1:], rtol=1e-5, atol=1e-6
        )


def test_the_cached_kernel_is_used_again_and_depends_on_the_orbit(kernel):
    path, _ = kernel
    stamp = path.stat().st_mtime_ns
    assert target_kernel(PROBLEM.with_outages([(24, 1.0)]), path.parent)[0] == path
    assert path.stat().st_mtime_ns == stamp
    assert {entry.name for entry in path.parent.iterdir()} == {path.name, f"{path.name}.blake2b"}


@pytest.mark.parametrize("damage", ["cut", "altered", "another", "digest"])
def test_a_cached_kernel_that_is_not_what_was_written_is_made_anew(damage, kernel, tmp_path):
    sound = kernel[0].read_bytes()
    path, seal = tmp_path / kernel[0].name, tmp_path / f"{kernel[0].name}.blake2b"
    seal.write_bytes(kernel[0].with_name(seal.name).read_bytes())
    place = len(sound) // 2
    altered = sound[:place] + bytes([sound[place] ^ 1]) + sound[place + 1 :]
    path.write_bytes({"cut": sound[:place], "altered": altered, "another": b"no kernel"}.get(damage, sound))
    if damage == "digest":
        seal.unlink()
    assert target_kernel(PROBLEM, tmp_path) == (path, kernel[1])
    assert path.read_bytes() == sound


def _generate(folder):
    return target_kernel(PROBLEM, folder)[0].read_bytes()


def test_processes_that_generate_at_once_leave_one_whole_kernel(tmp_path, kernel):
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        contents = pool.map(_generate, [tmp_path, tmp_path])
    assert contents[0] == contents[1] == kernel[0].read_bytes()
    assert len(list(tmp_path.iterdir())) == 2  # the kernel and its digest


def given(path, naif_id, **changes):
    fields = {"preset": "ppe-drm3", "target": {"kind": "spk", "path": str(path), "naif_id": naif_id}}
    return problem_from(fields | changes)


def test_any_spk_with_the_target_will_do(kernel):
    table, generated = target_table(given(*kernel)), target_table(PROBLEM, kernel[0].parent)
    for days in (0.0, 3.3, 77.7, 150.0):
        np.testing.assert_array_equal(state_at(table, days), state_at(generated, days))
    # Mars's barycentre is in DE440, about the Sun and not the Moon: the table is fitted through SPICE.
    kernels = [spiceypy.kdata(i, "SPK")[0] for i in range(spiceypy.ktotal("SPK"))]
    planets = next(Path(path) for path in kernels if path.endswith("de440.bsp"))
    assert read_orbit(planets, 4) is None
    mars = target_table(given(planets, 4))
    for days in (0.0, 12.3, 150.0):
        value, rate, _ = state_at(mars, days)
        # 3e8 km carry 6e-8 km of rounding; T_15' = 225 over half a record for the rates.
        np.testing.assert_allclose(value * LU_KM, from_moon(4, days)[:3], rtol=0, atol=1e-5)
        np.testing.assert_allclose(rate * VU_KM_S, from_moon(4, days)[3:], rtol=0, atol=1e-8)


def test_a_kernel_without_the_target_or_the_span_is_refused(kernel, tmp_path):
    path, naif_id = kernel
    with pytest.raises(SpkError, match=r"expected an object -7, got -60092"):
        target_kernel(given(path, -7))
    late = given(path, naif_id, departure={"epoch": "2026-09-01T00:00:00"})
    with pytest.raises(
        SpkError, match=r"over 2026-09-01T.*\.\.2027-03-20.*, got 2026-04-21T.*\.\.2026-11-12"
    ):
        target_kernel(late)
    text = tmp_path / "text.bsp"
    text.write_text("not a kernel")
    with pytest.raises(SpkError, match=r"text\.bsp: expected an SPK kernel, got a file of kind"):
        target_kernel(given(text, naif_id))


def test_neighbouring_records_of_the_kernel_meet(kernel):
    orbit = read_orbit(*kernel)
    alternating = (-1.0) ** np.arange(orbit.coefficients.shape[1])
    gaps = [np.abs(a.sum(axis=0) - alternating @ b).max() for a, b in pairwise(orbit.coefficients)]
    assert max(gaps) < 1e-6  # the defect that the correction leaves


def test_spice_is_free_while_an_orbit_is_made(tmp_path, monkeypatch):
    # Another thread reads ephemerides in the middle of it; with the lock of SPICE it would wait for its end.
    tables = []

    def meanwhile(*arguments):
        reader = threading.Thread(target=lambda: tables.append(body_table(0.0, 0.0, 1.0)), daemon=True)
        reader.start()
        reader.join(60.0)
        return made(*arguments)

    made = target._ballistic
    monkeypatch.setattr(target, "_ballistic", meanwhile)
    target_kernel(PROBLEM, tmp_path)
    assert len(tables) == 1
