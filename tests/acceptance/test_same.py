"""`make same` in short: the same bits from the process pool, from Ray, and from a cluster that was joined."""

import pytest

from service.spec import spec_from
from tests.acceptance.same_everywhere import PLACES, QUICK, RUNNER, specification, summary

#: Half as many segments as usual, so that a solve takes a second or two; and so many guesses that on any
#: processor one leads to a transfer.
SHORT = {
    "campaign": {"name": "short", "rng_seed": 2026},
    "problem": {"preset": "ppe-drm3", "n_segments": 20},
    "search": [
        {"id": "s0", "strategy": "S(0)", "guesses": 4},
        {
            "id": "s1-0",
            "strategy": "S(1|0)",
            "outages": [{"segment": 10, "duration_days": 1.0}],
            "seeds": {"from": "s0"},
            "mapping": "continued",
        },
    ],
}


@pytest.mark.ray
def test_a_campaign_finds_the_same_bits_on_the_process_pool_on_ray_and_on_four_nodes(simulated_cluster):
    found = summary(spec_from(SHORT), (PLACES[1], PLACES[3]), RUNNER, simulated_cluster)
    assert all(place["solutions"] >= 2 for place in found["places"].values()), found
    assert found["equal"], found


def test_another_number_of_guesses_replaces_that_of_the_specification():
    few = specification(QUICK, guesses=3)
    assert few.search[0].guesses == 3 and few.search[1:] == specification(QUICK, None).search[1:]
