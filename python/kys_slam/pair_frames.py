# SPDX-License-Identifier: BSD-3-Clause
"""Rectified stereo frames of recordings that are no sequence folders."""

import sys
from itertools import chain, islice
from typing import Callable, Dict, Iterator, NamedTuple, Optional, Tuple, Union

import numpy as np

from ._core import (InputError, StereoCamera, StereoRectifier, StereoRig, is_same_image,
                    note_of_bits, to_gray, used_bits)
from .colour import rectified

#: pairs that tell how many of 16 bits a camera uses
_FIRST_PAIRS = 10

Rig = Union[StereoRig, Callable[[Tuple[int, int]], StereoRig]]


def _bits_of(image: np.ndarray) -> int:
    return used_bits(image) if image.dtype == np.uint16 else 0


class PairFrame(NamedTuple):
    """A rectified stereo pair."""

    index: int  #: position in the recording, from 0
    name: str
    timestamp: float  #: s
    left: np.ndarray  #: (H, W) uint8
    right: np.ndarray  #: (H, W) uint8
    colour: Optional[np.ndarray] = None  #: left, (H, W, 3) uint8 RGB, with Recording.keep_colour


class Recording:
    """Frames of a recording, in order: iterate over it once."""

    def __init__(self, name: str, layout: str, rig: Rig, pairs: Iterator,
                 size: Optional[int], counts: Dict[str, int], start: int,
                 why_none: Callable[[], str]) -> None:
        """
        rig: the calibration, or a function that returns it for a size (width, height) of images.
        pairs: those from number `start` on: name, time (s), left, right image, and a function that
            returns the left image as (H, W, 3) RGB, None: it has no colour.
        why_none: what to say when there are none.
        """
        self.name, self.layout = name, layout
        self.ground_truth = None
        self.has_images = True
        self.counts = counts  #: images that were left out, by why
        self.keep_colour = False  #: frames have `colour` where their images have
        self._pairs, self._size, self._start = pairs, size, start
        self._first = list(islice(pairs, 1))
        if not self._first:
            raise InputError(f"{name}: holds no stereo pair" +
                             (f" at {start} (start)" if start else "") + why_none())
        if self._first[0][2].dtype == np.uint16:  # the first image of a camera that wakes up may be dark
            self._first += islice(pairs, _FIRST_PAIRS - 1)
        self._bits = max(_bits_of(image) for pair in self._first for image in pair[2:4]) or 16
        note = note_of_bits(self._bits)
        self.notes = [f"{name}: {note}"] if note else []  #: warnings for the user
        height, width = self._first[0][2].shape[:2]
        if callable(rig):
            rig = rig((width, height))
        rig.set_image_size(width, height)
        self.rig = rig
        camera = rig.rectified()
        self._rectifier = None if camera else StereoRectifier(rig)
        self.camera: StereoCamera = camera or self._rectifier.camera

    def __len__(self) -> int:
        return min(self._size or 0, sys.maxsize)  # of a damaged bag, anything

    def __iter__(self) -> Iterator[PairFrame]:
        first, self._first = self._first, []
        for index, pair in enumerate(chain(first, self._pairs), self._start):
            yield self._rectified(index, pair)

    def _rectified(self, index: int, pair) -> PairFrame:
        name, stamp, left, right, colour = pair
        left, right = (to_gray(i, bits=self._bits) if i.dtype == np.uint16 else i for i in (left, right))
        size = (self.camera.height, self.camera.width)
        for side, image in (("left", left), ("right", right)):
            if image.shape[:2] != size:
                raise InputError(f"{self.name}: frame {name}: the {side} image is "
                                 f"{image.shape[1]}x{image.shape[0]} px, the first one "
                                 f"{size[1]}x{size[0]}")
        if self._rectifier:
            # What is the same image before rectification stays one.
            same = is_same_image(left, right)
            left = self._rectifier.rectify_left(left)
            right = left if same else self._rectifier.rectify_right(right)
        return PairFrame(index, name, stamp, left, right, self._colour(colour, size))

    def _colour(self, colour, size: Tuple[int, int]) -> Optional[np.ndarray]:
        image = colour() if self.keep_colour else None
        return rectified(self._rectifier, image) if image is not None and image.shape[:2] == size else None
