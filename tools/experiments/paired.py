# SPDX-License-Identifier: BSD-3-Clause
"""Statistics of paired runs: the same input, seed and case under two configurations."""
import dataclasses
import math

import numpy as np
from scipy import stats

CONFIDENCE = 0.95
RESAMPLES = 5000
LEAST_INTERVAL = 3  # pairs; of fewer nothing is said about the spread
LEAST_WILCOXON = 6  # pairs; with fewer the test cannot reach 5 %, and there is no verdict
SIGNIFICANCE = 0.05


@dataclasses.dataclass
class Difference:
    """Of the second of each pair less the first; None: too few pairs to say."""

    pairs: int
    mean: float | None
    low: float | None  # bootstrap interval of the mean, 95 %
    high: float | None
    wilcoxon_p: float | None

    @property
    def verdict(self):
        """"smaller" or "larger" when the interval excludes 0 and Wilcoxon's test agrees: the bootstrap of
        few pairs alone is too narrow, and finds differences where there are none."""
        if self.pairs < LEAST_WILCOXON:
            return "too few pairs"
        if self.wilcoxon_p is None or self.wilcoxon_p >= SIGNIFICANCE or self.low <= 0 <= self.high:
            return "no difference shown"
        return "smaller" if self.high < 0 else "larger"


def difference(baseline, values):
    """Paired difference values - baseline; both are sequences of equal length, without None.

    The interval is a percentile bootstrap of the mean with a seed of its own: the same numbers give
    the same interval. Wilcoxon's signed-rank test, two-sided. A verdict needs both, and 6 pairs.
    """
    d = np.asarray(values, float) - np.asarray(baseline, float)
    if len(d) == 0:
        return Difference(0, None, None, None, None)
    low = high = p = None
    if len(d) >= LEAST_INTERVAL:
        if np.ptp(d) == 0:
            low = high = float(d[0])
        else:
            found = stats.bootstrap((d,), np.mean, confidence_level=CONFIDENCE, method="percentile",
                                    n_resamples=RESAMPLES, rng=np.random.default_rng(1))
            low, high = map(float, found.confidence_interval)
    if len(d) >= LEAST_WILCOXON and np.any(d != 0):
        p = float(stats.wilcoxon(d).pvalue)
    return Difference(len(d), float(d.mean()), low, high, p)


def mean(values):
    values = [v for v in values if v is not None and math.isfinite(v)]
    return float(np.mean(values)) if values else None


def deviation(values):
    values = [v for v in values if v is not None and math.isfinite(v)]
    return float(np.std(values, ddof=1)) if len(values) > 1 else None
