"""A target from a user's own SPK: the flagship's NRHO in another form, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
import spiceypy

from core.constants import SECONDS_PER_DAY
from core.ephemeris import furnish, state_at
from core.ephemeris.daf import SpkError
from core.ephemeris.spk import new_spk, read_orbit
from core.epochs import seconds_past_j2000
from core.orbits.target import target_kernel, target_table
from core.problem import ProblemError, SpkTarget, load_problem, problem_from
from core.tolerances import violation
from core.transcription import transcribe
from core.units import LU_KM, VU_KM_S
from core.verification.verify import verify

VECTORS = Path(__file__).parents[2] / "acceptance" / "vectors.json"
#: The flagship, with coasts as long as the known solution needs: a shorter span, and less to fit.
BOUNDS = {"initial_coast_days": (0.0, 10.5), "final_coast_days": (0.0, 15.5)}
FLAGSHIP = problem_from({"preset": "ppe-drm3", "bounds": BOUNDS}).with_outages([(24, 1.0)])
DEPARTURE_ET = seconds_past_j2000(FLAGSHIP.departure.epoch)
OWN_ID = -31415


def known():
    return np.array(json.loads(VECTORS.read_text(encoding="utf-8"))["S(1|0)"][1])


def written(path, centre, naif_id=OWN_ID, days=(0.0, 147.0)):
    """Write the flagship's NRHO as states about a centre: type 13, which coastarc makes no target of."""
    generated, nrho_id = target_kernel(FLAGSHIP)
    furnish(generated)
    # A tenth of a radian at perilune, through six samples: a polynomial of degree 11.
    et = np.arange(DEPARTURE_ET + days[0] * SECONDS_PER_DAY, DEPARTURE_ET + days[1] * SECONDS_PER_DAY, 180.0)
    states = np.array([spiceypy.spkgeo(nrho_id, moment, "J2000", centre)[0] for moment in et])
    with new_spk(path, "the flagship's NRHO") as handle:
        spiceypy.spkw13(handle, naif_id, centre, "J2000", et[0], et[-1], "own", 11, len(et), states, et)
    return path


def with_target(path, naif_id=OWN_ID):
    target = {"kind": "spk", "path": str(path), "naif_id": naif_id}
    return problem_from(FLAGSHIP.model_dump(mode="json") | {"target": target})


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """The flagship with its target from a kernel about the Earth."""
    return with_target(written(tmp_path_factory.mktemp("own") / "station.bsp", 399))


def test_the_states_of_the_target_are_those_of_the_kernel(own):
    assert read_orbit(own.target.path, OWN_ID) is None  # so it has to be fitted
    table, generated = target_table(own), target_table(FLAGSHIP)
    for days in np.random.default_rng(31).uniform(0.0, own.latest_arrival_days, 300):
        found, expected = state_at(table, days), state_at(generated, days)
        # What a fit may leave out: core/ephemeris/spk.py.
        np.testing.assert_allclose(found[0] * LU_KM, expected[0] * LU_KM, rtol=0, atol=2e-4)
        np.testing.assert_allclose(found[1] * VU_KM_S, expected[1] * VU_KM_S, rtol=0, atol=2e-7)


def test_a_known_solution_closes_on_it_and_passes_the_verifier(own):
    own_defects, flagship_defects = (transcribe(one).defects(known()) for one in (own, FLAGSHIP))
    assert violation(own_defects.reshape(-1, 7)) < 1.0
    # The other target is off by less than 2e-4 km and 2e-7 km/s, which 30 days of coast and thrust amplify.
    np.testing.assert_allclose(own_defects, flagship_defects, rtol=0, atol=0.05)
    found = verify(own, known())
    assert found.strict and found.failure == ""
    assert found.kernels[1] == ("station.bsp", own.target.digest)


def test_the_name_and_the_place_of_the_file_do_not_matter_but_its_content_does(own, tmp_path):
    copy = tmp_path / "elsewhere.bsp"
    copy.write_bytes(own.target.path.read_bytes())
    assert with_target(copy).hash == own.hash != FLAGSHIP.hash
    with copy.open("ab") as stream:
        stream.write(b"\0")
    assert with_target(copy).hash != own.hash


def test_a_file_that_was_changed_since_is_refused(own, tmp_path):
    copy = tmp_path / "copy.bsp"
    copy.write_bytes(own.target.path.read_bytes())
    stored = with_target(copy).model_dump(mode="json")
    copy.write_bytes(copy.read_bytes() + b"\0")
    with pytest.raises(ProblemError, match=r"expected the SPK file with digest .* has been changed since"):
        problem_from(stored)


def test_a_target_is_valid_without_its_file_and_reading_the_file_changes_no_target(tmp_path):
    target = SpkTarget(kind="spk", path=tmp_path / "late.bsp", naif_id=OWN_ID)
    with pytest.raises(ValueError, match=r"expected an SPK file, got \S+late\.bsp, which is not a file"):
        target.with_file_read()
    target.path.write_bytes(b"some content")
    read = target.with_file_read()
    assert (target.digest, read.digest) == (None, read.digest_now())


def circle(path, radius_km):
    """Write a circle about the Moon, in 20 days round, by its positions and velocities."""
    seconds = np.arange(-1.0, 150.0, 0.05) * SECONDS_PER_DAY
    rate = 2 * np.pi / (20 * SECONDS_PER_DAY)
    cosine, sine, zero = np.cos(rate * seconds), np.sin(rate * seconds), 0 * seconds
    states = radius_km * np.column_stack([cosine, sine, zero, -rate * sine, rate * cosine, zero])
    et = DEPARTURE_ET + seconds
    with new_spk(path, "a circle") as handle:
        spiceypy.spkw13(handle, OWN_ID, 301, "J2000", et[0], et[-1], "circle", 7, len(et), states, et)
    return path


def test_another_orbit_under_the_same_name_is_read_anew(tmp_path):
    path = tmp_path / "station.bsp"
    for radius_km in (50_000.0, 60_000.0):
        circle(tmp_path / "new.bsp", radius_km).replace(path)
        value = state_at(target_table(with_target(path)), 33.3)[0]
        assert np.linalg.norm(value) * LU_KM == pytest.approx(radius_km, abs=1e-3)
        furnish(path)
        place = spiceypy.spkgeo(OWN_ID, DEPARTURE_ET + 33.3 * SECONDS_PER_DAY, "J2000", 301)[0]
        assert np.linalg.norm(place[:3]) == pytest.approx(radius_km, abs=1e-3)


def test_a_path_is_relative_to_the_file_that_it_stands_in(own, tmp_path, monkeypatch):
    (tmp_path / "station.bsp").write_bytes(own.target.path.read_bytes())
    fields = FLAGSHIP.model_dump(mode="json")
    fields["target"] = {"kind": "spk", "path": "station.bsp", "naif_id": OWN_ID}
    (tmp_path / "problem.json").write_text(json.dumps(fields))
    monkeypatch.chdir("/")
    found = load_problem(tmp_path / "problem.json")
    assert found.target.path == (tmp_path / "station.bsp").resolve() and found.hash == own.hash


def test_an_orbit_about_a_centre_that_nobody_knows_is_refused(tmp_path):
    path = tmp_path / "lost.bsp"
    et = DEPARTURE_ET + np.linspace(-1.0, 200.0, 50) * SECONDS_PER_DAY
    with new_spk(path, "about an unknown body") as handle:
        states = np.tile([1000.0, 0, 0, 0, 1.0, 0], (len(et), 1))
        spiceypy.spkw13(handle, OWN_ID, -27182, "J2000", et[0], et[-1], "lost", 3, len(et), states, et)
    with pytest.raises(SpkError, match=r"expected -31415 about a centre whose way to the Moon is known"):
        target_table(with_target(path))


def test_a_kernel_with_a_moon_of_its_own_is_refused(tmp_path):
    path = tmp_path / "merged.bsp"
    et = DEPARTURE_ET + np.linspace(-1.0, 200.0, 50) * SECONDS_PER_DAY
    states = np.tile([384400.0, 0, 0, 0, 1.0, 0], (len(et), 1))
    with new_spk(path, "a station and a moon") as handle:
        for body in (OWN_ID, 301):
            spiceypy.spkw13(handle, body, 399, "J2000", et[0], et[-1], "body", 3, len(et), states, et)
    with pytest.raises(SpkError, match=r"expected no Sun, Earth, Moon or planets .* got 301; .*spkmerge"):
        target_kernel(with_target(path))
