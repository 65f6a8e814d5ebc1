# SPDX-License-Identifier: BSD-3-Clause
"""Reads feature files (README.md, versions 1 and 2). Needs NumPy.

    from feature_file import FeatureFile
    file = FeatureFile("kitti07.features")
    for frame in file.frames(): frame.left.x, frame.left.descriptors, frame.left.label, ...
    file.truth()
"""
import math
import struct
import zlib
from dataclasses import dataclass

import numpy as np

MASK = (1 << 64) - 1


class FeatureFileError(Exception):
    """The file is not what it should be; one line that names it."""


@dataclass
class Features:
    """Columns of one image's features. Priors are None where the frame has none."""
    x: np.ndarray            # px
    y: np.ndarray            # px
    angle: np.ndarray        # rad
    response: np.ndarray
    octave: np.ndarray
    landmark: np.ndarray     # -1: outlier
    descriptors: np.ndarray  # n x 4, uint64
    label: np.ndarray = None      # 65535: void
    instance: np.ndarray = None
    scale: np.ndarray = None      # px^2 m^2
    moving: np.ndarray = None
    motion: np.ndarray = None     # mu, 0..100


@dataclass
class Frame:
    index: int
    left: Features
    right: Features
    mover_share: float


@dataclass
class Object:
    label: int
    kind: int                # 0 stands, 1 rigid, 2 sways
    half_size: np.ndarray    # m
    first_frame: int
    poses: np.ndarray        # k x 7: tx ty tz qx qy qz qw, object to world


def mix(x):
    """SplitMix64's finaliser, of an array of uint64."""
    with np.errstate(over="ignore"):
        x = x + np.uint64(0x9e3779b97f4a7c15)
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xbf58476d1ce4e5b9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94d049bb133111eb)
    return x ^ (x >> np.uint64(31))


def hash_of(a, b, c):
    a, b, c = (np.asarray(v, np.uint64) for v in (a, b, c))
    return mix(mix(mix(mix(a) ^ b) ^ c))


class _Bytes:
    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, count):
        if count < 0 or self.at + count > len(self.data):
            raise ValueError("too short")
        self.at += count
        return self.data[self.at - count:self.at]

    def numbers(self, code):
        return struct.unpack("<" + code, self.take(struct.calcsize("<" + code)))

    def planes(self, count, dtype):
        width = np.dtype(dtype).itemsize
        planes = np.frombuffer(self.take(count * width), np.uint8).reshape(width, count)
        return np.ascontiguousarray(planes.T).view("<" + np.dtype(dtype).str[1:]).reshape(count)


class FeatureFile:
    def __init__(self, path):
        self.path = str(path)
        with open(path, "rb") as file:
            self.data = file.read()
        try:
            self._read_head()
        except (ValueError, struct.error) as error:
            raise FeatureFileError(f"{self.path}: {error}") from error

    def _checked(self, begin, count):
        block = self.data[begin:begin + count]
        if len(block) < count or len(self.data) < begin + count + 4:
            raise ValueError("truncated")
        if zlib.crc32(block) != struct.unpack_from("<I", self.data, begin + count)[0]:
            raise ValueError("wrong checksum")
        return block

    def _read_head(self):
        if self.data[:8] != b"KYSFEAT1":
            raise ValueError("not a feature file")
        self.version, size = struct.unpack_from("<II", self.data, 8)
        if (self.version, size) not in ((1, 96), (2, 144)):
            raise ValueError("unknown version")
        self._checked(0, size - 4)
        self.width, self.height = struct.unpack_from("<II", self.data, 16)
        names = ("fx", "fy", "cx", "cy", "baseline", "scale_factor")
        self.camera = dict(zip(names, struct.unpack_from("<6d", self.data, 24)))
        self.seed, self.frame_count, self.levels = struct.unpack_from("<QQI", self.data, 72)
        self.label_space, truth_bytes, self._truth_size = "", 0, 0
        if self.version == 2:
            name, truth_bytes, self._truth_size = struct.unpack_from("<32sQQ", self.data, 92)
            self.label_space = name.split(b"\0")[0].decode()
        self.poses = np.frombuffer(self._checked(size, 64 * self.frame_count),
                                   "<f8").reshape(-1, 8)  # time tx ty tz qx qy qz qw
        self._truth_at = size + 64 * self.frame_count + 4
        self._truth_bytes = truth_bytes
        self._frames_at = self._truth_at + truth_bytes

    def truth(self):
        """(objects, landmarks): landmarks as arrays position (n x 3, m), object, label."""
        if self.version == 1:
            return [], (np.zeros((0, 3)), np.zeros(0, int), np.zeros(0, int))
        try:
            packed = self._checked(self._truth_at, self._truth_bytes - 4)
            b = _Bytes(zlib.decompress(packed, -15))
            object_count, landmark_count = b.numbers("II")
            objects = []
            for _ in range(object_count):
                label, kind, hx, hy, hz, first, count = b.numbers("HHfffII")
                poses = np.frombuffer(b.take(56 * count), "<f8").reshape(count, 7)
                objects.append(Object(label, kind, np.array([hx, hy, hz]), first, poses))
            position = np.stack([b.planes(landmark_count, "f4") for _ in range(3)], axis=1)
            return objects, (position, b.planes(landmark_count, "i4"),
                             b.planes(landmark_count, "u2"))
        except (ValueError, struct.error, zlib.error) as error:
            raise FeatureFileError(f"{self.path}: objects: {error}") from error

    def frames(self):
        at = self._frames_at
        for index in range(self.frame_count):
            try:
                mark, size, checksum = struct.unpack_from("<III", self.data, at)
                payload = self.data[at + 12:at + 12 + size]
                if mark != 0x4d415246 or len(payload) < size or zlib.crc32(payload) != checksum:
                    raise ValueError("corrupt")
                yield self._frame(index, payload)
            except (ValueError, struct.error, zlib.error, IndexError) as error:
                raise FeatureFileError(f"{self.path}: frame {index}: {error}") from error
            at += 12 + size

    def _frame(self, index, payload):
        if self.version == 1:
            left, right = struct.unpack_from("<II", payload)
            dtype = np.dtype([("x", "<u2"), ("y", "<u2"), ("angle", "<u2"), ("response", "u1"),
                              ("octave", "u1"), ("landmark", "<i4"), ("words", "<u8", 4)])
            rows = np.frombuffer(payload, dtype, left + right, 8)
            sides = [Features(r["x"] / 32, r["y"] / 32, r["angle"] * (2 * math.pi / 65536),
                              r["response"], r["octave"], r["landmark"], r["words"])
                     for r in (rows[:left], rows[left:])]
            return Frame(index, *sides, 0.0)
        b = _Bytes(zlib.decompress(payload[4:], -15))
        left, right, flags, share = b.numbers("IIBf")
        return Frame(index, self._side(b, left, flags), self._side(b, right, flags), share)

    def _side(self, b, n, flags):
        x, y, angle = (b.planes(n, "u2") for _ in range(3))
        response, octave = b.planes(n, "u1"), b.planes(n, "u1")
        landmark = b.planes(n, "i4")
        f = Features(x / 32, y / 32, angle * (2 * math.pi / 65536), response, octave, landmark,
                     self._descriptors(b, landmark))
        if flags & 1:
            count = b.numbers("H")[0]
            table = np.frombuffer(b.take(12 * count), np.dtype(
                [("label", "<u2"), ("moving", "<u2"), ("instance", "<i4"), ("scale", "<f4")]))
            void = np.array([(65535, 0, -1, 0)], table.dtype)
            rows = np.concatenate([void, table])[b.planes(n, "u2")]
            f.label, f.instance, f.scale = rows["label"], rows["instance"], rows["scale"]
            f.moving = rows["moving"] != 0
            f.motion = 101.0 ** (b.planes(n, "u1") / 255) - 1
        return f

    def _descriptors(self, b, landmark):
        n = len(landmark)
        kind = b.planes(n, "u1")
        family = b.planes(int((kind == 2).sum()), "u2")
        with np.errstate(over="ignore"):
            state = np.cumsum(b.planes(int((kind == 3).sum()), "u8"), dtype=np.uint64)
        counts = np.zeros(n, int)
        counts[kind != 0] = b.planes(int((kind != 0).sum()), "u1")
        gaps = np.frombuffer(b.take(int(counts.sum())), np.uint8).astype(int)
        raw = b.planes(4 * int((kind == 0).sum()), "u8").reshape(-1, 4)
        key = np.zeros(n, np.uint64)
        key[kind == 1] = hash_of(self.seed, 3, landmark[kind == 1].astype(np.int64).view(np.uint64))
        key[kind == 2] = hash_of(self.seed, 4, family)
        key[kind == 3] = mix(state)
        words = np.stack([hash_of(key, 0xdec0de, i) for i in range(4)], axis=1)
        words[kind == 0] = raw
        # Positions of the flipped bits: sums of the gaps, anew for each feature.
        owner = np.repeat(np.arange(n), counts)
        total = np.cumsum(gaps)
        before = np.concatenate([[0], total])[np.concatenate([[0], np.cumsum(counts)])[:-1]]
        at = total - before[owner]
        np.bitwise_xor.at(words, (owner, at // 64), np.uint64(1) << (at % 64).astype(np.uint64))
        return words
