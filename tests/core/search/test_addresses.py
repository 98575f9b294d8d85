"""Random numbers follow from the address of a hop and from nothing else."""

import itertools

import numpy as np
import pytest

from core.search import HopAddress, hop_rng

HERE = HopAddress(kind=0, search=1, case=2, chain=3, hop=4)


def numbers(address, rng_seed=7):
    return hop_rng(rng_seed, address).random(1000)


def test_the_same_address_gives_the_same_numbers_again():
    np.testing.assert_array_equal(numbers(HERE), numbers(HopAddress(0, 1, 2, 3, 4)))


@pytest.mark.parametrize("part", HopAddress._fields)
def test_another_address_gives_unrelated_numbers(part):
    other = numbers(HERE._replace(**{part: getattr(HERE, part) + 1}))
    # Two streams of 1000 correlate by 1/sqrt(1000) = 0.03; five deviations.
    assert abs(np.corrcoef(numbers(HERE), other)[0, 1]) < 0.16


def test_another_rng_seed_gives_other_numbers():
    assert not np.any(numbers(HERE) == numbers(HERE, rng_seed=8))


def test_numbers_that_move_from_field_to_field_make_another_address():
    streams = [tuple(numbers(HopAddress(*parts))[:3]) for parts in itertools.permutations(range(5))]
    assert len(set(streams)) == 120


def test_the_hash_of_a_solution_may_be_a_chain():
    chain = int("f" * 32, 16)
    assert numbers(HERE._replace(kind=1, chain=chain)).shape == (1000,)
    assert not np.any(numbers(HERE._replace(chain=chain)) == numbers(HERE._replace(chain=chain - 2**64)))
