# SPDX-License-Identifier: BSD-3-Clause
"""Which features of two images show the same point, without their descriptors: dense disparity of a stereo
pair, dense flow between two frames, or depth and poses. And how far their descriptors are apart.

    pair = partners(features(left), features(right), stereo_field(left, right))
    counts = DistanceCounts()
    counts.add(pair, hamming(bits_of_left, bits_of_right))
    counts.quantiles()                               # {"matching": [...], "other": [...]}

Needs OpenCV.
"""

from typing import Dict, List, NamedTuple, Tuple

import numpy as np

from ._core import MATCHING_SHARES, OTHER_SHARES, InputError

NEAR = 1.5  #: px, from where a keypoint should be in the other image: it shows the same point
FAR = 10.0  #: px, from there on it shows another one
_LEAST_PAIRS = 1000  # that show the same point, for quantiles


class Partners(NamedTuple):
    """Of the features of two images."""

    matching: np.ndarray  #: (M, 2) indices of features that show the same point, each at most once
    known: np.ndarray  #: (N,) bool: it is known where a feature of the first image is in the second
    expected: np.ndarray  #: (N, 2) px, there; nan where it is not known
    second: np.ndarray  #: (M, 2) px, positions of the features of the second image


def stereo_field(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(H, W, 2) float32: where pixels of the left image are in the right one, px; nan: not known. By
    semi-global matching in both directions."""
    import cv2

    steps = max(64, (left.shape[1] // 8 + 15) // 16 * 16)
    matcher = cv2.StereoSGBM_create(0, steps, 5, P1=200, P2=800, uniquenessRatio=10, speckleWindowSize=100,
                                    speckleRange=2)
    to_right = matcher.compute(left, right).astype(np.float32) / 16
    mirrored = matcher.compute(np.ascontiguousarray(right[:, ::-1]), np.ascontiguousarray(left[:, ::-1]))
    to_left = mirrored[:, ::-1].astype(np.float32) / 16
    rows, columns = np.indices(left.shape, np.float32)
    there = columns - to_right
    back = cv2.remap(to_left, there, rows, cv2.INTER_NEAREST, borderValue=-1)
    good = (to_right > 0) & (np.abs(back - to_right) < 1)
    return np.where(good[:, :, None], np.stack([there, rows], axis=2), np.nan).astype(np.float32)


def flow_field(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The same from one frame to a later one, by dense inverse search in both directions."""
    import cv2

    search = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    to_second, to_first = search.calc(first, second, None), search.calc(second, first, None)
    rows, columns = np.indices(first.shape, np.float32)
    there = np.stack([columns, rows], axis=2) + to_second
    back = cv2.remap(to_first, there[:, :, 0], there[:, :, 1], cv2.INTER_LINEAR,
                     borderMode=cv2.BORDER_CONSTANT, borderValue=(1e6, 1e6))
    good = np.linalg.norm(back + to_second, axis=2) < 1
    return np.where(good[:, :, None], there, np.nan).astype(np.float32)


def partners(a: Dict[str, np.ndarray], b: Dict[str, np.ndarray], field: np.ndarray) -> Partners:
    """Of the features of two images, as Features gives them: near where they should be, and of the same
    level or the next."""
    first, second = a["positions"], b["positions"]
    height, width = field.shape[:2]
    at = np.rint(first).astype(int)
    inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
    at = np.where(inside[:, None], at, 0)
    # The field is of whole pixels; what a position is beside its pixel it is beside its partner's.
    expected = np.where(inside[:, None], field[at[:, 1], at[:, 0]] + (first - at), np.nan)
    known = np.isfinite(expected).all(axis=1)
    if not known.any() or len(second) == 0:
        return Partners(np.zeros((0, 2), int), known, expected, second)
    of = np.nonzero(known)[0]
    gap = np.linalg.norm(expected[of, None] - second[None], axis=2)
    levels = np.abs(a["octaves"][of, None].astype(int) - b["octaves"][None].astype(int))
    gap[levels > 1] = np.inf
    nearest = gap.argmin(axis=1)
    mutual = gap.argmin(axis=0)[nearest] == np.arange(len(of))
    good = mutual & (gap[np.arange(len(of)), nearest] < NEAR)
    return Partners(np.stack([of[good], nearest[good]], axis=1), known, expected, second)


def hamming(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N, M) of descriptors (N, B) and (M, B) uint8, bits."""
    x, y = (np.unpackbits(d, axis=1).astype(np.float32) for d in (a, b))
    return np.rint(x.sum(axis=1)[:, None] + y.sum(axis=1)[None] - 2 * (x @ y.T)).astype(int)


def mutual_matches(pairs: Partners, distance: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """(N,) bool: features of the first image that have a mutual nearest neighbour, and those of them whose
    neighbour is where it should be. distance: (N, M)."""
    nearest, back = distance.argmin(axis=1), distance.argmin(axis=0)
    mutual = back[nearest] == np.arange(len(nearest))
    gap = np.linalg.norm(pairs.second[nearest] - pairs.expected, axis=1)
    return mutual, mutual & pairs.known & (gap < NEAR)


class DistanceCounts:
    """Histograms of the Hamming distances of pairs that show the same point and of those that do not."""

    def __init__(self) -> None:
        self.matching, self.other = np.zeros(257, int), np.zeros(257, int)

    def add(self, pairs: Partners, distance: np.ndarray) -> None:
        """distance: (N, M), bits."""
        self.matching += np.bincount(distance[pairs.matching[:, 0], pairs.matching[:, 1]], minlength=257)
        gap = np.linalg.norm(pairs.expected[pairs.known][:, None] - pairs.second[None], axis=2)
        self.other += np.bincount(distance[pairs.known][gap > FAR], minlength=257)

    def quantiles(self) -> Dict[str, List[float]]:
        """For Features and YAML files. Raises InputError for too few pairs."""
        if self.matching.sum() < _LEAST_PAIRS or self.other.sum() < 10 / OTHER_SHARES[0]:
            raise InputError(f"{self.matching.sum()} pairs of features that show the same point, and "
                             f"{self.other.sum()} that do not: too few to measure distances")
        return {"matching": _quantiles(self.matching, MATCHING_SHARES),
                "other": _quantiles(self.other, OTHER_SHARES)}


def _quantiles(counts: np.ndarray, shares: List[float]) -> List[float]:
    """Bits below or at which these shares lie; a distance of d bits fills d - 0.5 to d + 0.5."""
    total = np.concatenate([[0], np.cumsum(counts)]) / counts.sum()
    edges = np.arange(258) - 0.5
    steps = np.concatenate([[True], np.diff(total) > 0])  # where it rises: its inverse is unique
    return [round(float(np.clip(v, 0, 256)), 2) for v in np.interp(shares, total[steps], edges[steps])]
