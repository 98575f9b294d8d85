"""Tests against textbook examples, and changes against seeds by hand."""

from math import isnan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.analysis.campaign_statistics import findings_of, row
from core.analysis.comparison import compare_groups, holm, paired_change, paired_changes, wilcoxon_p
from tests.core.analysis.solves import campaign, failed, solved


def child(name, seed, propellant_kg, segment=4, **changes):
    return solved(name, propellant_kg, segment, seeds_from="S(0)", seed_k=0, seed_id=seed, **changes)


def test_fishers_test_is_that_of_the_lady_tasting_tea():
    # Fisher, The Design of Experiments (1935): 3 of 4 and 1 of 4; both tails are 34 of 70.
    one = [solved("a"), solved("b"), solved("c"), failed()]
    (found,) = compare_groups({"milk first": one, "tea first": [solved("d"), failed(), failed(), failed()]})
    assert found.fisher_p == pytest.approx(34 / 70, rel=1e-12)  # sums of binomial coefficients
    assert (found.n_solutions_one, found.n_solves_one) == (3, 4)
    assert (found.n_solutions_other, found.n_solves_other) == (1, 4)


def test_delta_v_is_compared_by_rank():
    cheap = [solved(name, mass) for name, mass in (("a", 100.0), ("b", 150.0), ("c", 200.0))]
    dear = [solved(name, mass) for name, mass in (("d", 300.0), ("e", 350.0), ("f", 500.0))]
    (found,) = compare_groups({"dear": dear, "cheap": cheap})
    # Of the 20 ways to rank three of six, this one and its opposite are the most extreme.
    assert found.mann_whitney_p == pytest.approx(2 / 20, rel=1e-12)  # rounding
    assert found.dearer == 1.0
    assert found.median_difference_km_s == pytest.approx(0.4, rel=1e-12)  # 200 kg of 500 a km/s


def test_equal_strategies_do_not_differ():
    (found,) = compare_groups({"one": [solved("a")] * 12, "other": [solved("b")] * 15})
    assert (found.mann_whitney_p, found.fisher_p, found.dearer) == (1.0, 1.0, 0.5)


def test_holms_correction_is_that_of_its_textbook_example():
    # As p.adjust of R gives it.
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02], rel=1e-12)  # rounding


def test_what_could_not_be_tested_is_no_member_of_the_family():
    corrected = holm([0.02, float("nan"), 0.5])
    assert corrected[0] == 0.04 and isnan(corrected[1]) and corrected[2] == 0.5
    assert holm([]) == []


@given(st.lists(st.floats(0.0, 1.0), max_size=8))
def test_corrected_values_keep_their_order_between_the_plain_ones_and_bonferronis(p_values):
    corrected = holm(p_values)
    for p, q in zip(p_values, corrected, strict=True):
        assert p <= q <= min(1.0, len(p_values) * p)
    assert sorted(corrected) == [q for _, q in sorted(zip(p_values, corrected, strict=True))]


def test_a_family_is_corrected_as_one():
    groups = {name: [solved("a")] * n + [failed()] * (20 - n) for name, n in (("a", 1), ("b", 10), ("c", 19))}
    family = compare_groups(groups)
    assert [(one.one, one.other) for one in family] == [("a", "b"), ("a", "c"), ("b", "c")]
    assert min(one.fisher_holm_p for one in family) == 3 * min(one.fisher_p for one in family)
    (alone,) = compare_groups(groups, [("a", "b")])
    assert alone.fisher_holm_p == alone.fisher_p == family[0].fisher_p


def test_an_empty_group_is_compared_with_nothing():
    (found,) = compare_groups({"some": [solved("a")], "none": []})
    assert isnan(found.fisher_p) and isnan(found.mann_whitney_p) and found.n_solves_other == 0


def test_the_signed_rank_test_of_changes_of_one_sign_is_a_toss_of_coins():
    assert wilcoxon_p([-1.0, -2.0, -3.0, -4.0, -5.0]) == pytest.approx(2 / 2**5, rel=1e-12)  # rounding
    assert wilcoxon_p([0.0, -1.0, 0.0, -1.0]) == pytest.approx(2 / 2**2, rel=1e-12)  # ties and zeros


def test_no_change_is_no_evidence_and_no_pair_no_number():
    assert wilcoxon_p([0.0] * 30) == 1.0
    assert isnan(wilcoxon_p([]))


def test_a_solution_is_compared_with_its_own_seed():
    solves = [
        *(solved("a", 300.0), solved("b", 500.0)),
        *(child("c", "a", 290.0), child("d", "b", 530.0), child("e", "a", 280.0), child("f", "a", 300.0)),
    ]
    (found,) = paired_changes(findings_of(campaign(*solves)))
    assert (found.strategy, found.n_seeds, found.propellant_kg.n) == ("S(1|0)", 2, 4)
    assert (found.propellant_kg.least, found.propellant_kg.greatest) == (-20.0, 30.0)
    assert found.propellant_kg.median == -5.0
    assert found.delta_v_km_s.mean == pytest.approx(0.0, abs=1e-15)  # 0 kg in all; rounding
    assert found.cheaper.value == 0.5
    # Changes of one seed are no independent witnesses: -10 for a, 30 for b.
    assert found.wilcoxon_p == 1.0


def test_a_change_that_no_verifier_can_tell_is_none():
    seeds = [solved(name, 300.0) for name in "abcdef"]
    same = [child(f"{name}1", name, 300.0 - 1e-9) for name in "abcde"]
    (found,) = paired_changes(findings_of(campaign(*seeds, *same, child("f1", "f", 299.0))))
    # One of six by a kilogram; the strict tolerance of masses is 0.01 kg.
    assert (found.propellant_kg.n, found.cheaper.value, found.wilcoxon_p) == (6, 1 / 6, 1.0)


def test_pairs_need_a_solution_at_the_level_and_a_seed_that_is_known():
    solves = [
        solved("a", 300.0, is_strict=False),
        *(child("b", "a", 310.0), child("c", "z", 320.0), child("d", "a", 330.0, is_strict=False)),
        failed((4,), seeds_from="S(0)", seed_k=0, seed_id="a"),
    ]
    findings = findings_of(campaign(*solves))
    assert paired_change(findings, solves).propellant_kg.n == 1
    assert paired_change(findings, solves, "paper").propellant_kg.n == 2


def test_no_pairs_make_a_row_of_nothing():
    cells = row(paired_change(findings_of(campaign()), []))
    assert cells["propellant_kg_n"] == 0 and cells["cheaper"] is None and cells["wilcoxon_p"] is None
