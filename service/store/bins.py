"""Outcomes over time in a bounded number of bins, which grow wider as a campaign grows older."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.store.outcomes import OUTCOMES

#: Each a multiple of the one before, so that bins merge into wider ones [s].
WIDTHS_S = (1, 5, 15, 30, 60, 300, 900, 1800, 3600, 7200, 21600, 43200, 86400)
MOST_BINS = 120


class OutcomeBins:
    """How many solves ended how, from the start of a campaign on."""

    def __init__(self, start: float) -> None:
        self.start = start
        self.width_s: int = WIDTHS_S[0]
        #: One row per outcome, one column per bin.
        self.counts = np.zeros((len(OUTCOMES), 0), dtype=np.int64)

    def add(self, outcomes: NDArray[np.int64], times: NDArray[np.float64]) -> None:
        """Count solves by the numbers of their outcomes and the times at which they were stored."""
        after = np.maximum(times - self.start, 0.0)
        self._widen_to(float(after.max()))
        bins = (after // self.width_s).astype(np.int64)
        n_bins = max(self.counts.shape[1], int(bins.max()) + 1)
        counts = np.zeros((len(OUTCOMES), n_bins), dtype=np.int64)
        counts[:, : self.counts.shape[1]] = self.counts
        np.add.at(counts, (outcomes, bins), 1)
        self.counts = counts

    def _widen_to(self, latest: float) -> None:
        while latest >= MOST_BINS * self.width_s:
            wider = next((width for width in WIDTHS_S if width > self.width_s), 2 * self.width_s)
            self._merge(wider // self.width_s)
            self.width_s = wider

    def _merge(self, n_merged: int) -> None:
        n_bins = self.counts.shape[1]
        missing = -n_bins % n_merged
        padded = np.pad(self.counts, ((0, 0), (0, missing)))
        self.counts = padded.reshape(len(OUTCOMES), -1, n_merged).sum(axis=2)

    def lists(self) -> dict[str, Any]:
        """Return the counts by name of outcome."""
        return {name: row.tolist() for name, row in zip(OUTCOMES, self.counts, strict=True)}
