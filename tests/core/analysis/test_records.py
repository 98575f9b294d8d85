import numpy as np
import pytest
import spiceypy
from numpy.polynomial.chebyshev import chebval

from core.ephemeris.kernels import furnish
from core.verification.heyoka_check import links_of, read_runs
from core.world import EARTH
from tests.core.analysis.by_hand import ORIGIN_ET

DAY = 86400.0
STOP_ET = ORIGIN_ET + 100.3 * DAY
LINKS = links_of(EARTH)


def place(run, et):
    record = run.record_at(et)
    return chebval((et - record.middle) / record.radius, record.coefficients)


def test_the_records_give_the_places_that_spice_gives():
    furnish()
    for run, (target, centre) in zip(read_runs(LINKS, ORIGIN_ET, STOP_ET), LINKS, strict=True):
        for et in np.linspace(ORIGIN_ET, STOP_ET, 101):
            expected, _ = spiceypy.spkgps(target, float(et), "J2000", centre)
            # Some roundings of the last bit of the largest coefficient.
            assert place(run, float(et)) == pytest.approx(expected, abs=1e-15 * np.linalg.norm(expected))


def test_only_what_touches_the_span_is_read():
    for run in read_runs(LINKS, ORIGIN_ET, STOP_ET):
        assert 0.0 <= ORIGIN_ET - run.start_et < run.length
        assert 0.0 <= run.start_et + len(run.words) * run.length - STOP_ET < run.length


def test_at_a_boundary_the_record_that_begins_there_holds():
    run = read_runs(LINKS, ORIGIN_ET, STOP_ET)[0]
    boundary = run.start_et + 3 * run.length
    assert run.record_at(boundary).middle == boundary + 0.5 * run.length
    assert run.record_at(np.nextafter(boundary, 0.0)).middle == boundary - 0.5 * run.length
