# SPDX-License-Identifier: BSD-3-Clause
"""Reads the map that a run leaves (map.ply)."""

from typing import Dict, NamedTuple

import numpy as np

from ._core import InputError
from .files import PathLike, read_bytes

_TYPES = {"float": "<f4", "uchar": "u1", "int": "<i4"}


class LandmarkMap(NamedTuple):
    """Landmarks of the trajectory's sub-map, in its frame."""

    #: (L,) with x, y, z (m), red, green, blue (by class), class, instance (-1: none),
    #: belief (probability of standing still), observations (keyframes that see it)
    points: np.ndarray
    label_space: str  #: "": no landmark has a class
    classes: Dict[int, str]  #: names of the classes that occur


def read_map(path: PathLike) -> LandmarkMap:
    """Reads map.ply. Raises InputError for other files."""
    head, end, body = read_bytes(path).partition(b"end_header\n")
    lines = [line.split() for line in head[:65536].decode("ascii", "replace").splitlines()]
    if not end or lines[:2] != [["ply"], ["format", "binary_little_endian", "1.0"]]:
        raise InputError(f"{path}: not a map.ply of this program")
    try:
        fields = [(w[2], _TYPES[w[1]]) for w in lines if w[0] == "property"]
        count = next(int(w[2]) for w in lines if w[:2] == ["element", "vertex"])
        classes = {int(w[2]): " ".join(w[3:]) for w in lines if w[:2] == ["comment", "class"]}
        space = next((w[2] for w in lines if w[:2] == ["comment", "label_space"]), "")
        table = np.dtype(fields)
        if count < 0 or len(body) != count * table.itemsize:
            raise InputError(f"{path}: {len(body)} bytes of points, {count} points were announced")
    except (ValueError, KeyError, IndexError, StopIteration) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: not a map.ply of this program") from None
    return LandmarkMap(np.frombuffer(body, table), space, classes)
