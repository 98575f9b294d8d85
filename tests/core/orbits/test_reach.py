"""What the thrust of a problem reaches beside what it has to, and what is said of it."""

import pytest

from core.orbits.reach import reach_of, remarks_on
from core.problem import load_problem, problem_from
from workers.measure_oracles import cases, problem_of


@pytest.mark.parametrize("case", [*cases(), "ppe-drm3", "earth-mars"])
def test_thrust_that_suffices_is_no_cause_for_a_remark(case, tmp_path):
    problem = problem_of(cases()[case], tmp_path) if case in cases() else load_problem(case)
    reach = reach_of(problem)
    assert reach.needed_km_s < reach.reachable_km_s and remarks_on(problem) == []


def test_thrust_that_cannot_suffice_is_told_with_numbers_and_the_remedy():
    craft = load_problem("earth-mars").spacecraft.model_dump() | {"max_thrust_n": 0.002}
    weak = problem_from({"preset": "earth-mars", "spacecraft": craft})
    first, second = remarks_on(weak)
    # 2 mN x 700 days / 1500 kg, of which 4 kg are burnt; even two impulses need 5.6 km/s.
    assert reach_of(weak).reachable_km_s == pytest.approx(0.002 * 700 * 86400 / 1500 / 1e3, rel=2e-3)
    assert "no guess can close: 0.002 N for 700 days on 1500 kg give at most 0.0808 km/s" in first
    assert 1.0 < reach_of(weak).needed_km_s < 5.6 and "bounds.shooting_days" in first
    assert second.startswith("acceleration at departure: 0.00133 mm/s^2 is outside the tested range of 0.03")
