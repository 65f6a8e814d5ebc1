# SPDX-License-Identifier: BSD-3-Clause
"""Networks for keypoints and descriptors as ONNX files, by ONNX Runtime. A YAML file says what the network
wants and gives (docs/features.md).

    features = FeatureNetwork("xfeat.yaml").features()
    slam = kys_slam.System(camera, features=features)

Needs onnxruntime, PyYAML and OpenCV.
"""

import hashlib
from typing import Any, Dict, Optional, Tuple

import numpy as np

from .features import Features
from .segment_network import OnnxNetwork

KINDS = ("cells", "points")
_CELL = 8  # px, of kind cells


def strongest(scores: np.ndarray, most: int) -> np.ndarray:
    """Indices of the `most` largest, the largest first; equal ones by index."""
    return np.argsort(-scores, kind="stable")[:most]


def score_map(cells: np.ndarray) -> np.ndarray:
    """(8 h, 8 w) probabilities of (65, h, w) logits, the last one for no keypoint in a cell."""
    exponential = np.exp(cells - cells.max(axis=0))
    share = exponential[:-1] / exponential.sum(axis=0)
    _, h, w = share.shape
    return share.reshape(_CELL, _CELL, h, w).transpose(2, 0, 3, 1).reshape(_CELL * h, _CELL * w)


def peaks(scores: np.ndarray, radius: int, least: float) -> Tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the maxima within a radius."""
    import cv2

    largest = cv2.dilate(scores, np.ones((2 * radius + 1, 2 * radius + 1), np.uint8))
    inside = np.zeros(scores.shape, bool)
    inside[1:-1, 1:-1] = True
    return np.nonzero((scores == largest) & (scores > least) & inside)


def refined(scores: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(N, 2) x, y of maxima to a fraction of a pixel: parabolas through the logarithms of three scores."""
    log = np.log(np.maximum(scores, 1e-6))

    def shift(before: np.ndarray, at: np.ndarray, after: np.ndarray) -> np.ndarray:
        bend = before - 2 * at + after
        return np.where(bend < -1e-6, np.clip((before - after) / (2 * np.minimum(bend, -1e-6)), -0.5, 0.5), 0)

    at = log[rows, columns]
    x = columns + shift(log[rows, columns - 1], at, log[rows, columns + 1])
    y = rows + shift(log[rows - 1, columns], at, log[rows + 1, columns])
    return np.stack([x, y], axis=1)


def sampled(plane: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(N, C) values of (C, h, w) at x, y of its own pixels, bicubic (Keys, 1981, a = -0.75), edges
    repeated."""
    _, h, w = plane.shape
    base = np.floor(at).astype(int)
    t = (at - base).astype(np.float32)

    def weights(t: np.ndarray) -> list:
        a = np.float32(-0.75)
        far = lambda d: ((a * d - 5 * a) * d + 8 * a) * d - 4 * a
        near = lambda d: ((a + 2) * d - (a + 3)) * d * d + 1
        return [far(t + 1), near(t), near(1 - t), far(2 - t)]

    wx, wy = weights(t[:, 0]), weights(t[:, 1])
    rows = np.ascontiguousarray(plane.transpose(1, 2, 0))
    result = np.zeros((len(at), len(plane)), np.float32)
    for i in range(4):
        y = np.clip(base[:, 1] + i - 1, 0, h - 1)
        for j in range(4):
            x = np.clip(base[:, 0] + j - 1, 0, w - 1)
            result += rows[y, x] * (wx[j] * wy[i])[:, None]
    return result


class FeatureNetwork(OnnxNetwork):
    """An ONNX network for features and what its YAML file says about it."""

    def _read_settings(self) -> None:
        self.kind = self._get("output", "kind")
        if self.kind not in KINDS:
            self.fail(f"{self.path}: output.kind is '{self.kind}', not one of {', '.join(KINDS)}")
        entry = self._get("input")
        self.multiple = self._whole("input.multiple", entry.get("multiple", 0), 0, 1024)
        if self.multiple:
            entry.setdefault("size", [self.multiple, self.multiple])  # until there is an image
        self._read_input(channels=self._whole("input.channels", entry.get("channels", 1), 1, 3))
        self.name = str(self._get("name"))
        output = self.settings["output"]
        self.most = self._whole("features", self.settings.get("features", 2000), 1, 60000)
        self.least = self._finite("output.min_score", output.get("min_score", 0))
        self.radius = self._whole("output.radius", output.get("radius", 2), 1, 64)
        self.normalised = bool(output.get("normalised", False))

    def _whole(self, name: str, value: Any, low: int, high: int) -> int:
        number = self._finite(name, value)
        if number != int(number) or not low <= number <= high:
            self.fail(f"{self.path}: {name} is {value}, not a whole number from {low} to {high}")
        return int(number)

    def features(self, most: Optional[int] = None) -> Features:
        """For System. most: features per image; None: what the file says. Its name has a digest of the
        weights and of what changes the bits of descriptors."""
        if most is not None:
            self.most = most
        s = self.settings
        with self._reading(self.path):
            bits = f"{self.digest} {s.get('seed', 0)} {s.get('centre')} {s.get('period', 0)}"
            digest = hashlib.sha256(bits.encode()).hexdigest()[:12]
            return Features(self, f"{self.name}:{digest}", reach=s.get("reach", 1.5),
                            pixel_sigma=s.get("pixel_sigma", 0.5), seed=s.get("seed", 0),
                            centre=s.get("centre"), period=s.get("period", 0),
                            distances=s.get("distances"))

    def __call__(self, image: np.ndarray) -> Dict[str, np.ndarray]:
        """Features of an (H, W) uint8 image, the strongest first, as Features takes them."""
        height, width = image.shape
        if self.multiple:
            self.height = max(1, height // self.multiple) * self.multiple
            self.width = max(1, width // self.multiple) * self.multiple
        tensor = self.prepare(np.repeat(image[:, :, None], 3, axis=2))
        values = self._outputs_of({self.inputs[0]: tensor}, None)
        decode = self._of_cells if self.kind == "cells" else self._of_points
        positions, descriptors, scores = decode(values)
        # Images are stretched by their areas.
        stretch = np.array([width / self.width, height / self.height])
        positions = (positions + 0.5) * stretch - 0.5
        norm = np.linalg.norm(descriptors, axis=1, keepdims=True)
        return {"positions": positions, "descriptors": descriptors / np.maximum(norm, 1e-12),
                "scores": scores}

    def _output(self, values: Dict[str, np.ndarray], key: str) -> np.ndarray:
        name = self.settings["output"].get(key, key)
        array = np.asarray(values[self._check_output(key, name)])
        return array[0] if array.ndim > 1 and array.shape[0] == 1 else array

    def _of_cells(self, values: Dict[str, np.ndarray]) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        cells, plane = self._output(values, "cells"), self._output(values, "descriptors")
        if cells.ndim != 3 or len(cells) != _CELL * _CELL + 1 or plane.ndim != 3:
            self.fail(f"{self.path}: the network gives cells {cells.shape} and descriptors {plane.shape}, "
                      "not (65, h, w) and (D, h, w)")
        scores = score_map(cells)
        rows, columns = peaks(scores, self.radius, self.least)
        at = np.stack([columns, rows], axis=1).astype(np.float64)
        # As XFeat and SuperPoint were trained: the last pixel at the edge of the last cell.
        size = np.array([scores.shape[1], scores.shape[0]], float)
        in_plane = lambda p, of: p * np.array([of.shape[2], of.shape[1]]) / (size - 1) - 0.5
        strength = scores[rows, columns]
        if "reliability" in self.settings["output"]:
            reliability = self._output(values, "reliability")
            if reliability.ndim != 3:
                self.fail(f"{self.path}: reliability is {reliability.shape}, not (1, h, w)")
            strength = strength * np.clip(sampled(reliability, in_plane(at, reliability))[:, 0], 0, 1)
        best = strongest(strength, self.most)
        positions = refined(scores, rows[best], columns[best])
        return positions, sampled(plane, in_plane(at[best], plane)), strength[best]

    def _of_points(self, values: Dict[str, np.ndarray]) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        positions = self._output(values, "keypoints").astype(np.float64)
        descriptors = self._output(values, "descriptors").astype(np.float32)
        scores = np.ravel(self._output(values, "scores")).astype(np.float32)
        if positions.ndim != 2 or positions.shape[1] != 2 or descriptors.ndim != 2:
            self.fail(f"{self.path}: the network gives keypoints {positions.shape} and descriptors "
                      f"{descriptors.shape}, not (N, 2) and (N, D)")
        if len(descriptors) != len(positions) and descriptors.shape[1] == len(positions):
            descriptors = descriptors.T
        if not len(positions) == len(descriptors) == len(scores):
            self.fail(f"{self.path}: the network gives {len(positions)} keypoints, {len(descriptors)} "
                      f"descriptors and {len(scores)} scores")
        if self.normalised:  # -1 to 1 over the image
            positions = (positions + 1) / 2 * (np.array([self.width, self.height]) - 1)
        best = strongest(scores, self.most)
        best = best[scores[best] > self.least] if len(scores) else best
        return positions[best], descriptors[best], scores[best]
