"""Exported states: whole trajectories without gaps, and what cannot be exported."""

import numpy as np
import pytest

from core.constants import G0, SECONDS_PER_DAY
from core.export import ExportError, export_states
from core.export.states import SHORTEST_S
from core.problem import problem_from
from core.verification.verify import verify
from tests.core.export.solution import PROBLEM, trajectories, vector


@pytest.mark.parametrize("index", [0, 1])
def test_arcs_follow_each_other_from_departure_to_arrival(index):
    own, x = trajectories()[index], vector()
    for arc, after in zip(own.arcs, own.arcs[1:], strict=False):
        assert arc.et[-1] == after.et[0]
        assert np.all(np.diff(arc.et) > 0)
    part = x[:3] if index == 0 else x[154:157]
    begin = 0.0 if index == 0 else x[1] + 23 * x[0] / 50 + 1.0  # the coast, 23 of 50 segments, the outage
    # Epochs are spaced by 1.2e-7 s.
    assert own.stop_et - own.start_et == pytest.approx((begin + part.sum()) * SECONDS_PER_DAY, abs=1e-5)


def test_a_realization_is_the_reference_until_its_outage():
    reference, realization = trajectories()
    kinds = [(arc.kind, arc.segment) for arc in realization.arcs]
    assert kinds[:24] == [("coast", 0), *(("thrust", segment) for segment in range(1, 24))]
    # Its initial coast of no length is left out.
    assert [kind for kind, _ in kinds].count("outage") == 1 and kinds[24][0] == "outage"
    assert realization.outage_et == realization.arcs[24].et[0] == reference.arcs[24].et[0]
    for mine, shared in zip(realization.arcs[:24], reference.arcs[:24], strict=True):
        np.testing.assert_array_equal(mine.states, shared.states)


def test_the_jump_at_the_matchpoint_is_the_verified_defect():
    defects = verify(PROBLEM, vector()).defects
    for own, defect in zip(trajectories(), defects, strict=True):
        after = next(i for i, arc in enumerate(own.arcs) if arc.et[0] == own.matchpoint_et)
        jump = own.arcs[after - 1].states[-1] - own.arcs[after].states[0]
        # Two integrators, tables and kernels: 2e-7 km of the Moon's place, amplified on the way to 5 m.
        assert jump[:3] == pytest.approx(defect[:3], abs=0.01)
        assert jump[3:6] == pytest.approx(defect[3:6], abs=1e-8)


def test_thrust_and_mass_flow_are_those_of_the_rocket_equation():
    exhaust = PROBLEM.spacecraft.isp_s * G0
    for own in trajectories():
        for arc in own.arcs:
            flow = (arc.states[0, 6] - arc.states[-1, 6]) / (arc.et[-1] - arc.et[0])
            # A mass of 13 t holds 2e-12 kg, an arc lasts hours.
            assert flow == pytest.approx(np.linalg.norm(arc.thrust_n) / exhaust, abs=1e-14)
            assert (arc.kind == "thrust") or not arc.thrust_n.any()


def test_arcs_of_no_length_are_left_out_without_a_gap():
    x = vector().copy()
    x[1] = x[2] = 0.0  # both coasts of the reference
    x[155] = 0.5 * SHORTEST_S / SECONDS_PER_DAY
    reference, realization = export_states(PROBLEM, x)
    assert {arc.kind for arc in reference.arcs} == {"thrust"}
    assert all(a.et[-1] == b.et[0] for a, b in zip(realization.arcs, realization.arcs[1:], strict=False))
    (after,) = (i for i, arc in enumerate(realization.arcs) if arc.kind == "outage")
    before, begun = realization.arcs[after], realization.arcs[after + 1]
    # Epochs are spaced by 1.2e-7 s.
    np.testing.assert_allclose(begun.states[0, :3], before.states[-1, :3], rtol=0, atol=3e-7)


def test_a_flight_into_the_earth_is_refused():
    falling = {"kind": "state", "epoch": "2026-04-26T14:47:58", "mass_kg": 13000.0}
    falling |= {"position_km": (50000.0, 0.0, 0.0), "velocity_km_s": (0.0, 0.0, 0.0)}
    problem = problem_from({"preset": "ppe-drm3", "departure": falling})
    with pytest.raises(ExportError, match="expected a flight from departure to target, got one that meets a"):
        export_states(problem, vector()[:154])
