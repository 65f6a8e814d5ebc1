# SPDX-License-Identifier: BSD-3-Clause
"""Statistics of paired runs: the same input, seed and case under two configurations."""
import dataclasses
import math

import numpy as np
from scipy import stats

CONFIDENCE = 0.95
RESAMPLES = 5000
LEAST_INTERVAL = 3  # pairs; of fewer nothing is said about the spread
LEAST_VERDICT = 6  # pairs; of fewer no interval is reliable, and Wilcoxon's test cannot reach 5 %
WIDEST = math.log(1.5)  # an interval that includes no change and reaches farther decides nothing
SIGNIFICANCE = 0.05
RULE = ("Smaller or larger: the 95 % interval of the ratio excludes 1, and Wilcoxon's test agrees (p below "
        f"{SIGNIFICANCE}). No difference shown: the interval includes 1 and stays within "
        f"{math.exp(-WIDEST):.2f} and {math.exp(WIDEST):.2f}. Too wide to say: anything else, and fewer than "
        f"{LEAST_VERDICT} pairs.")


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
        """RULE, for differences of logarithms."""
        if self.pairs < LEAST_VERDICT:
            return "too wide to say"
        if self.low <= 0 <= self.high:
            return "no difference shown" if max(-self.low, self.high) <= WIDEST else "too wide to say"
        if self.wilcoxon_p is None or self.wilcoxon_p >= SIGNIFICANCE:
            return "too wide to say"
        return "smaller" if self.high < 0 else "larger"


def expanded(pairs):
    """Level of the percentile interval that covers 95 % with few pairs: the percentile bootstrap is too
    narrow by sqrt((n - 1) / n) and takes the normal in place of Student's distribution (Hesterberg,
    "What teachers should know about the bootstrap", 2015, Section 5.2)."""
    t = stats.t.ppf((1 + CONFIDENCE) / 2, pairs - 1)
    return 1 - 2 * stats.norm.cdf(-t * math.sqrt(pairs / (pairs - 1)))


def difference(baseline, values):
    """Paired difference values - baseline; both are sequences of equal length, without None.

    The interval is an expanded percentile bootstrap of the mean with a seed of its own: the same numbers
    give the same interval. Wilcoxon's signed-rank test, two-sided: the bootstrap of
    few pairs alone finds differences where there are none (7 % of six pairs).
    """
    d = np.asarray(values, float) - np.asarray(baseline, float)
    if len(d) == 0:
        return Difference(0, None, None, None, None)
    low = high = p = None
    if len(d) >= LEAST_INTERVAL:
        if np.ptp(d) == 0:
            low = high = float(d[0])
        else:
            found = stats.bootstrap((d,), np.mean, confidence_level=expanded(len(d)), method="percentile",
                                    n_resamples=RESAMPLES, rng=np.random.default_rng(1))
            low, high = map(float, found.confidence_interval)
    if len(d) >= LEAST_VERDICT and np.any(d != 0):
        p = float(stats.wilcoxon(d).pvalue)
    return Difference(len(d), float(d.mean()), low, high, p)


def mean(values):
    values = [v for v in values if v is not None and math.isfinite(v)]
    return float(np.mean(values)) if values else None


def deviation(values):
    values = [v for v in values if v is not None and math.isfinite(v)]
    return float(np.std(values, ddof=1)) if len(values) > 1 else None
