# SPDX-License-Identifier: BSD-3-Clause
"""Features of your own in place of ORB: a function from an image to keypoints and descriptors.

    def corners(image):                              # (H, W) uint8
        return positions, descriptors                # (N, 2) px, (N, D) float32 or (N, 32) uint8

    slam = kys_slam.System(camera, features=corners)
    slam = kys_slam.System(camera, features=kys_slam.Features(corners, name="mine", reach=1.5))

Floats become 256 bits (binarise), whose Hamming distance the system scales as that of ORB.
"""

import math
from typing import Any, Callable, Dict, Optional, Sequence

import numpy as np

from . import _core
from ._core import InputError

_KEYS = ("positions", "descriptors", "scores", "scales", "angles", "sigmas")


def binarise(descriptors: np.ndarray, seed: int = 0, centre: Optional[Sequence[float]] = None,
             period: float = 0) -> np.ndarray:
    """(N, 32) uint8 of (N, D) floats, the first bit in the lowest one. The same seed gives the same bits
    everywhere.

    Without period: signs of 256 random projections. Two descriptors at an angle a differ in 256 a / pi
    bits, on average. With period, in the descriptors' unit: steps along circles of two periods, of D
    orthonormal projections; the number of bits that differ grows with the L1 distance. About two standard
    deviations of a projection. centre: subtracted first. Raises InputError for numbers that are not finite.
    """
    descriptors = np.ascontiguousarray(descriptors, np.float32)
    if descriptors.ndim != 2:
        raise InputError(f"descriptors are of shape {descriptors.shape}, not (N, D)")
    return _core._binarise(descriptors, seed, [] if centre is None else [float(c) for c in centre],
                           float(period))


class Features:
    """A function from an image to its features, and what the system has to know of them.

    function: (H, W) uint8 to (positions, descriptors), or to a dict with further entries. One entry per
        feature, at most 65535 features:
        positions (N, 2): px, sub-pixel where they are; (0, 0) is the centre of the first pixel.
        descriptors (N, D) floats, or (N, 32) uint8 compared by Hamming distance.
        scores (N,): the strongest are used to recognise places.
        scales (N,): px of the image per px of the level it was found at, 1 the finest.
        angles (N,): rad, orientation.
        sigmas (N,): px, standard deviation of positions, in place of scales.
        The same image must give the same arrays.
    name: of the extractor and its weights; printable, no blanks. Maps are for features of one name.
    levels, scale_factor: a scale s is of level log(s) / log(scale_factor), rounded. With one level a
        feature is compared with all others, over `reach`.
    reach: factor on the distance, nearer or farther, over which a descriptor stays the same.
    pixel_sigma: px, standard deviation of positions at the finest level.
    seed, centre, period: see binarise().
    distances: {"matching": [...], "other": [...]}, quantiles of Hamming distances as `kys-slam features`
        measures them. None: limits tuned for ORB are used as they are, often badly.
    """

    def __init__(self, function: Callable[[np.ndarray], Any], name: str = "", *, levels: int = 1,
                 scale_factor: float = 1.2, reach: float = 1.5, pixel_sigma: float = 0.5, seed: int = 0,
                 centre: Optional[Sequence[float]] = None, period: float = 0,
                 distances: Optional[Dict[str, Sequence[float]]] = None, oriented: bool = False,
                 by_sigma: bool = False) -> None:
        """oriented: the function gives angles. by_sigma: levels are steps of sigmas, not of scales."""
        self.function = function
        self.name = name or getattr(function, "__name__", type(function).__name__).strip("<>")
        self.levels, self.scale_factor, self.reach = int(levels), float(scale_factor), float(reach)
        self.pixel_sigma, self.seed = float(pixel_sigma), int(seed)
        self.oriented, self.sizes = bool(oriented), not by_sigma
        self.centre = [] if centre is None else [float(c) for c in centre]
        self.period = float(period)
        binarise(np.zeros((1, 1), np.float32), period=self.period)  # refuses what makes no sense
        self.distances = None
        if distances is not None:
            try:
                self.distances = {key: [float(d) for d in distances[key]] for key in ("matching", "other")}
            except (KeyError, TypeError, ValueError):
                raise self._error("distances are no lists 'matching' and 'other' of numbers") from None

    def raw(self, image: np.ndarray) -> Dict[str, np.ndarray]:
        """Features of an image with their descriptors as the function gives them."""
        return self._of_image(image)

    def __call__(self, image: np.ndarray) -> Dict[str, np.ndarray]:
        """Features of an image with their descriptors as bits (N, 32)."""
        found = self._of_image(image)
        if not found["binary"]:
            found["descriptors"] = self.bits(found["descriptors"])
        return found

    def bits(self, descriptors: np.ndarray) -> np.ndarray:
        """(N, 32) uint8 of (N, D) floats."""
        return binarise(descriptors, self.seed, self.centre or None, self.period)

    def _error(self, what: str) -> InputError:
        return InputError(f"features '{self.name}': {what}")

    def _of_image(self, image: np.ndarray) -> Dict[str, Any]:
        """What the core takes, checked."""
        result = self.function(image)
        if isinstance(result, (tuple, list)) and len(result) == 2:
            result = dict(zip(_KEYS, result))
        if not isinstance(result, dict) or not {"positions", "descriptors"} <= set(result):
            raise self._error("gives neither (positions, descriptors) nor a dict with them")
        for key in result:
            if key not in _KEYS:
                raise self._error(f"gives '{key}', not one of {', '.join(_KEYS)}")
        positions = self._array(result, "positions")
        if positions.ndim != 2 or positions.shape[1] != 2:
            raise self._error(f"positions are of shape {positions.shape}, not (N, 2)")
        count = len(positions)
        descriptors = self._descriptors(result["descriptors"], count)
        column = lambda key, default: self._column(result, key, default, count)
        size = column("scales", 1) if self.sizes else column("sigmas", self.pixel_sigma) / self.pixel_sigma
        with np.errstate(divide="ignore", invalid="ignore"):
            level = np.round(np.log(size) / math.log(self.scale_factor))
        if not np.isfinite(level).all():
            raise self._error(f"{'scales' if self.sizes else 'sigmas'} are not all above 0")
        angles = np.mod(column("angles", 0), 2 * math.pi) if self.oriented else np.zeros(count)
        return {"positions": positions, "descriptors": descriptors, "binary": descriptors.dtype == np.uint8,
                "octaves": np.clip(level, 0, self.levels - 1).astype(np.uint8),
                "angles": angles.astype(np.float32), "scores": column("scores", 0)}

    def _array(self, result: dict, key: str) -> np.ndarray:
        try:
            array = np.ascontiguousarray(result[key], np.float32)
        except (TypeError, ValueError):
            raise self._error(f"{key} are no array of numbers") from None
        if not np.isfinite(array).all():
            raise self._error(f"{key} are not all finite")
        return array

    def _column(self, result: dict, key: str, default: float, count: int) -> np.ndarray:
        if result.get(key) is None:
            return np.full(count, default, np.float32)
        array = self._array(result, key)
        if array.shape != (count,):
            raise self._error(f"{key} are of shape {array.shape}, not ({count},)")
        return array

    def _descriptors(self, given: Any, count: int) -> np.ndarray:
        given = np.asarray(given)
        if given.ndim != 2 or len(given) != count:
            raise self._error(f"descriptors are of shape {given.shape}, not ({count}, D)")
        if given.dtype == np.uint8:
            if given.shape[1] != 32:
                raise self._error(f"descriptors of {given.shape[1]} bytes, not 32")
            return np.ascontiguousarray(given)
        return self._array({"descriptors": given}, "descriptors")
