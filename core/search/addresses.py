"""Where a hop stands in a campaign, and the random numbers that follow from that alone."""

from typing import NamedTuple

import numpy as np


class HopAddress(NamedTuple):
    """The place of one hop: integers only, no worker, attempt or time."""

    #: 0 for a hop job, 1 for a map job.
    kind: int
    #: Number of the search in its campaign, and of the case in its search.
    search: int
    case: int
    #: Number of the chain; for a map job the seed's solution hash read as an integer.
    chain: int
    #: Number of the hop in its chain.
    hop: int


def hop_rng(rng_seed: int, address: HopAddress) -> np.random.Generator:
    """Return the generator of one hop: the same wherever and however often it runs.

    Parameters
    ----------
    rng_seed : int
        The random-number seed of the campaign [-].
    address : HopAddress
        The hop.
    """
    return np.random.default_rng(np.random.SeedSequence(rng_seed, spawn_key=tuple(address)))
