"""Mappings as text: what each stands for, in which one way it is written, and what is refused."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.search import MAPPINGS, check_mapping, expand_mapping
from core.search.settings import assignment_of, check_family
from tests.core.transcription.points import PRESET, problem


def outages(*segments, days=1.0):
    return problem(tuple((segment, days) for segment in segments))


ONE, TWO = outages(8), outages(8, 24)
OTHER_TWO, THREE = outages(12, 40), outages(12, 20, 40)


@pytest.mark.parametrize(
    ("seed_segments", "segments", "count"),
    [
        # k'^k + 1: the paper's examples, then one source alone.
        ((8,), (12, 40), 2),
        ((8, 24), (12, 20, 40), 9),
        ((8, 24, 36), (4, 12, 20, 40), 82),
        ((), (12,), 1),
        ((), (12, 20, 40), 1),
        ((8,), (4, 12, 20, 40), 2),
    ],
)
@pytest.mark.parametrize("form", MAPPINGS)
def test_all_makes_as_many_guesses_as_there_are_assignments_and_one(seed_segments, segments, count, form):
    found = expand_mapping(f"{form}(all)", outages(*seed_segments), outages(*segments))
    assert len(found) == len(set(found)) == count
    assert found[0] == form


def test_all_lists_the_default_and_then_the_assignments_in_order():
    assert expand_mapping("all", ONE, OTHER_TWO) == ("reference", "reference(1,1)")
    found = expand_mapping("all", TWO, THREE)
    assert found[:4] == ("reference", "reference(1,1,1)", "reference(1,1,2)", "reference(1,2,1)")
    assert found[-1] == "reference(2,2,2)"
    assert expand_mapping("aligned(all)", TWO, THREE)[1] == "aligned(1,1,1)"


def test_all_between_as_many_outages_takes_every_choice_once():
    longer = outages(8, 24, days=1.5)
    assert expand_mapping("all", TWO, longer) == (
        "reference(0,0)", "reference(1,1)", "reference", "reference(2,1)", "reference(2,2)",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("seed_segments", "segments", "expected"),
    [
        ((), (12, 40), "reference"),
        ((8, 24), (12, 20, 40), "reference(1,2,2)"),
        # 16 is as far from 8 as from 24.
        ((8, 24), (9, 16, 17), "reference(1,1,2)"),
    ],
)
def test_nearest_takes_the_realization_of_the_closest_segment(seed_segments, segments, expected):
    assert expand_mapping("nearest", outages(*seed_segments), outages(*segments)) == (expected,)


def test_a_form_alone_takes_the_reference_of_its_seed():
    for form in MAPPINGS:
        assert expand_mapping(form, ONE, OTHER_TWO) == (form,)
        assert expand_mapping(f"{form}(0,0)", ONE, OTHER_TWO) == (form,)
        assert assignment_of(form, ONE, OTHER_TWO).sources == (0, 0)


def test_realizations_that_are_known_are_kept_unless_told_otherwise():
    # The paper's default uses none of the seed's realizations, ours keep what the seed survives already.
    assert assignment_of("reference", ONE, TWO).sources == (0, 0)
    for form in ("aligned", "continued"):
        assert assignment_of(form, ONE, TWO).sources == (1, 0)
        assert expand_mapping(f"{form}(1,0)", ONE, TWO) == (form,)
        assert expand_mapping(f"{form}(0,0)", ONE, TWO) == (f"{form}(0,0)",)
        assert assignment_of(f"{form}(0,0)", ONE, TWO).sources == (0, 0)
        assert assignment_of(form, outages(8, days=0.5), TWO).sources == (0, 0)


def test_with_as_many_outages_each_realization_comes_from_its_own():
    shorter = problem(((8, 0.5), (24, 1.0)))
    for form in MAPPINGS:
        assert assignment_of(form, shorter, TWO).sources == (1, 2)
        assert expand_mapping(f"{form}(1,2)", shorter, TWO) == (form,)
        assert expand_mapping(f"{form}(0,0)", shorter, TWO) == (f"{form}(0,0)",)


@given(st.sampled_from(MAPPINGS), st.lists(st.integers(0, 2), min_size=3, max_size=3), st.booleans())
def test_what_is_written_is_read_as_the_same_assignment(form, sources, is_spaced):
    text = f"{form}({(', ' if is_spaced else ',').join(map(str, sources))})"
    (canonical,) = expand_mapping(text, TWO, THREE)
    assert expand_mapping(canonical, TWO, THREE) == (canonical,)
    found = assignment_of(canonical, TWO, THREE)
    assert (found.form, found.sources) == (form, tuple(sources))


WRONG = ["", "closest", "reference()", "reference(1,)", "reference(01)", "reference(-1)", "aligned(1 2)"]
WRONG += [
    "All",
    "all(1)",
    "nearest(all)",
    "aligned(all,1)",
    "aligned(1",
    " aligned",
    "aligned\n",
    "continued(x)",
]


@pytest.mark.parametrize("text", WRONG)
def test_a_text_that_is_no_mapping_is_refused(text):
    with pytest.raises(ValueError, match="mapping: expected all, nearest or one of reference, aligned"):
        check_mapping(text)


@pytest.mark.parametrize("sources", ["", "(all)", "(nearest)", "(0)", "(10,0,2)", "(1, 2)"])
def test_every_form_may_have_sources(sources):
    for form in MAPPINGS:
        check_mapping(form + sources)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("reference(1,2)", r"mapping: expected 3 sources, one per outage, got 2 in 'reference\(1,2\)'"),
        ("aligned(0,3,1)", r"mapping: expected sources in 0..2, the seed's realizations, got 3 in"),
    ],
)
def test_sources_that_do_not_fit_are_refused(text, message):
    with pytest.raises(ValueError, match=message):
        expand_mapping(text, TWO, THREE)


def test_a_text_that_stands_for_several_is_no_mapping_of_one_seed():
    with pytest.raises(
        ValueError, match=r"expected one that makes one guess, got 'all', which makes 9 from k'"
    ):
        assignment_of("all", TWO, THREE)
    assert assignment_of("all", PRESET, THREE).sources == (0, 0, 0)


@pytest.mark.parametrize(("k_from", "k"), [(5, 6), (2, 49)])
def test_an_expansion_beyond_the_limit_is_refused_before_it_is_made(k_from, k):
    seeds, asked = outages(*range(1, k_from + 1)), outages(*range(1, k + 1))
    with pytest.raises(ValueError, match=rf"mapping: expected at most 10000 guesses .* {k_from}\^{k} \+ 1;"):
        expand_mapping("all", seeds, asked)


def test_only_fewer_or_shorter_outages_give_seeds():
    pairs = {"at most 1 outages, got 2": (TWO, ONE), "got the very same 1": (ONE, ONE)}
    pairs["or as many in the same segments .9., got .8."] = (ONE, outages(9, days=1.5))
    pairs["of at most 0.5 days in segment 24, got 1.0"] = (TWO, problem(((8, 1.5), (24, 0.5))))
    pairs["differs in its outages alone"] = (problem((), 49), ONE)
    for message, (seeds, asked) in pairs.items():
        with pytest.raises(ValueError, match=f"seed: expected .*{message}"):
            check_family(seeds, asked)
    for seeds, asked in itertools.pairwise([PRESET, ONE, TWO, outages(8, 24, days=1.5)]):
        check_family(seeds, asked)
