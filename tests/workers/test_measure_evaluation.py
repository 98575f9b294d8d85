"""What the benchmark compares is the same work: its arcs end where the plan's legs and SciPy's arcs end."""

import numpy as np
import pytest

from core.dynamics import STATE
from core.problem import load_problem
from core.transcription import transcribe
from workers.measure_evaluation import OUTAGES, bench_evaluate, ephemeris_nanoseconds, flight, fly_with_scipy


def point(transcription):
    lower, upper = transcription.bounds
    x = lower + (upper - lower) * np.random.default_rng(3).random(len(lower))
    return transcription.lift(x)


def test_scipy_flies_the_same_arcs():
    transcription = transcribe(load_problem("ppe-drm3"), tolerance=1e-12)
    found = flight(transcription, point(transcription), STATE)
    ends = fly_with_scipy(transcription, found)
    # Inside a leg an arc starts where the one before ended: the first leg's, without its coast.
    arcs = transcription.lifted.plan.leg_arcs[0]
    # 1e-12 a step, magnified over arcs of a day or of weeks.
    np.testing.assert_allclose(ends[: arcs - 1, :7], found.starts[1:arcs], rtol=0, atol=1e-9)


def test_the_times_of_the_parts_add_up_for_every_case():
    rows = bench_evaluate(load_problem("ppe-drm3"), rng_seed=1, n_points=1, repeats=1)
    assert [(row.n_segments, row.k) for row in rows] == [(n, k) for n in (50, 100) for k in OUTAGES]
    for row in rows:
        parts = row.ephemeris_ms + row.propagation_ms + row.assembly_ms
        assert row.hessian_ms > 0.0
        assert parts == pytest.approx(row.jacobian_ms, rel=1e-9)  # of one point, so that medians add up
    assert [row.scipy_over_ours is None for row in rows] == [False, True, True, True] * 2


def test_an_evaluation_of_the_bodies_takes_nanoseconds():
    assert 1.0 < ephemeris_nanoseconds(transcribe(load_problem("ppe-drm3"))) < 1e4
