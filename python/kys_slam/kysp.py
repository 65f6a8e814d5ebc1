# SPDX-License-Identifier: BSD-3-Clause
"""Reads and writes prior files (.kysp, version 1). Needs NumPy only.

The format is described byte by byte in priors/README.md. A file read and written again has the
same content; motion is stored as one of 256 values (see MOTION).

    frame = read("000123.kysp")
    frame.cameras[0].segment_map   # (H, W) uint16: 0 void, k = segments[k - 1]
    frame.cameras[0].motion        # (H, W) float32: mu, 0..100
    write("copy.kysp", frame)
"""

import os
import struct
import zlib
from dataclasses import dataclass, field

import numpy as np

MAGIC = b"KYSP\r\n\x1a\n"
HEADER = struct.Struct("<8sHHIIHHHHIQQ32s16s")  # 96 bytes
CAMERA = struct.Struct("<5I")
SEGMENT = np.dtype(
    [("label", "<u2"), ("flags", "<u2"), ("instance", "<i4"), ("scale", "<f4"), ("score", "<f4"),
     ("area", "<u4")])
THING, DYNAMIC, RADIAL_ONLY, NOT_JUDGED = 1, 2, 4, 8
RIGHT_INSTANCES = 1 << 30
VOID_LABEL = 0xFFFF
MAX_FILE_SIZE = 1 << 28  # bytes
MAX_SIDE = 16384  # px
MAX_SEGMENTS = 65535  # of a camera
MOTION = np.expm1(np.arange(256) * np.log(101.0) / 255.0).astype(np.float32)
MOTION[255] = 100.0


class FormatError(ValueError):
    """A prior file that is not sound; the message names the file and what is wrong."""


@dataclass
class Camera:
    """Priors of one camera. `segments` has dtype SEGMENT; its areas are filled in by write()."""

    segments: np.ndarray
    segment_map: np.ndarray  # (H, W) uint16
    motion: np.ndarray = None  # (H, W) float32, read inside dynamic segments


@dataclass
class Frame:
    """Priors of one stereo frame."""

    label_space: str
    cameras: list = field(default_factory=list)
    calibration_hash: int = 0
    content_key: int = 0
    has_motion: bool = False
    shares_instances: bool = False  # one object has one instance, plus 2^30 in the right camera


def calibration_hash(width, height, fx, fy, cx, cy, baseline):
    """64-bit FNV-1a of the rounded calibration, as the C++ function of that name."""

    def rounded(value):  # half away from zero
        return int(np.floor(abs(value) + 0.5)) * (1 if value >= 0 else -1)

    numbers = [int(width), int(height)] + [rounded(1e4 * v) for v in (fx, fy, cx, cy)]
    numbers.append(rounded(1e7 * baseline))
    value = 0xCBF29CE484222325
    for byte in struct.pack("<7q", *numbers):
        value = ((value ^ byte) * 0x100000001B3) & 0xFFFFFFFFFFFFFFFF
    return value or 1


def dynamic_by_number(segments):
    """(K + 1,) bool: whether a segment is dynamic, by its number in the map; 0 is void."""
    return np.concatenate([[False], (segments["flags"] & DYNAMIC) != 0])


def _varint(value):
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


class _Row:
    """Reads numbers from the bytes of one row."""

    def __init__(self, data, name):
        self.data, self.at, self.name = data, 0, name

    def byte(self):
        if self.at >= len(self.data):
            raise FormatError(f"{self.name}: a row is truncated")
        self.at += 1
        return self.data[self.at - 1]

    def varint(self):
        value = 0
        for shift in (0, 7, 14):
            byte = self.byte()
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
        raise FormatError(f"{self.name}: a number has more than three bytes")


def _motion_codes(motion, keep_sides=(8.0, 20.0)):
    """Codes of motion values: nearest in ln(1 + mu), on the same side of each kept value."""
    values = MOTION.astype(np.float64)
    upper = (np.sqrt((1 + values[:-1]) * (1 + values[1:])) - 1).astype(np.float32)
    for kept in keep_sides:
        upper[(values[:-1] <= kept) & (values[1:] > kept)] = kept
    return np.searchsorted(upper, np.asarray(motion, np.float32), side="left").astype(np.uint8)


def _runs(row):
    """Starts and ends of equal values."""
    edges = np.flatnonzero(row[1:] != row[:-1]) + 1
    return np.concatenate([[0], edges]), np.concatenate([edges, [len(row)]])


def _check(good, name, what):
    if not good:
        raise FormatError(f"{name}: {what}")


def encode(frame, name="prior file"):
    """The bytes of a prior file. Motion runs are exact (no tolerance). Raises FormatError for whatever
    readers refuse."""
    _check(1 <= len(frame.cameras) <= 2, name, "a frame has one or two cameras")
    label_space = str(frame.label_space).encode("utf-8")
    _check(1 <= len(label_space) <= 32 and all(0x20 < c < 0x7F for c in label_space), name,
           "label_space is not 1 to 32 characters from ! to ~")
    for field_name in ("calibration_hash", "content_key"):
        _check(0 <= getattr(frame, field_name) < 1 << 64, name, f"{field_name} has more than 64 bits")
    shape = np.shape(frame.cameras[0].segment_map)
    _check(len(shape) == 2 and 1 <= min(shape) and max(shape) <= MAX_SIDE, name,
           f"segment_map is not of two sides of 1..{MAX_SIDE}")
    body_at = HEADER.size + CAMERA.size * len(frame.cameras)
    entries, body = [], bytearray()
    for c, camera in enumerate(frame.cameras):
        segments = _segments_to_write(camera, c, shape, name)
        table, index, runs = segments.tobytes(), [], bytearray()
        dynamic = dynamic_by_number(segments)
        for y in range(shape[0]):
            index.append(len(runs))
            row = np.asarray(camera.segment_map[y])
            for start, end in zip(*_runs(row)):
                runs += _varint(int(end - start)) + _varint(int(row[start]))
            moving = dynamic[row]
            if moving.any():
                codes = _motion_codes(np.asarray(camera.motion[y])[moving])
                for start, end in zip(*_runs(codes)):
                    runs += _varint(int(end - start)) + bytes([codes[start]])
        index.append(len(runs))
        at = body_at + len(body)
        offsets = np.array(index, "<u4").tobytes()
        entries.append(CAMERA.pack(at, len(segments), at + len(table),
                                   at + len(table) + len(offsets), len(runs)))
        body += table + offsets + runs
    size = body_at + len(body)
    _check(size <= MAX_FILE_SIZE, name, "is too large for a prior file")
    header = HEADER.pack(MAGIC, 1, HEADER.size, size, 0, shape[1], shape[0], len(frame.cameras),
                         bool(frame.has_motion) + 2 * bool(frame.shares_instances), 0,
                         frame.calibration_hash, frame.content_key, label_space, b"")
    data = bytearray(header + b"".join(entries) + body)
    struct.pack_into("<I", data, 16, zlib.crc32(data[20:]))
    return bytes(data)


def _segments_to_write(camera, c, shape, name):
    """The table of a camera's segments with their areas; FormatError for a camera that readers refuse."""
    try:
        segments = np.array(camera.segments, dtype=SEGMENT)
    except (TypeError, ValueError, OverflowError) as error:
        raise FormatError(f"{name}: segments are not of dtype SEGMENT: {error}") from error
    count, segment_map = len(segments), np.asarray(camera.segment_map)
    _check(count <= MAX_SEGMENTS, name, f"has more than {MAX_SEGMENTS} segments in one camera")
    _check_segments(segments, c, name)
    _check(segment_map.shape == shape, name, "segment_map of the cameras differs in size")
    _check(np.issubdtype(segment_map.dtype, np.integer) and segment_map.min() >= 0
           and segment_map.max() <= count, name, "segment_map has a segment that is not in the table")
    moving = dynamic_by_number(segments)[segment_map]
    if moving.any():
        motion = np.asarray(camera.motion)
        _check(motion.shape == shape, name, "motion, which dynamic segments need, is not an image of "
               "the size of segment_map")
        motion = motion[moving].astype(np.float32)
        _check(((motion >= 0) & (motion <= 100)).all(), name, "motion is not in 0..100")
    segments["area"] = np.bincount(segment_map.ravel(), minlength=count + 1)[1:]
    return segments


def decode(data, name="prior file"):
    """A Frame from the bytes of a file. Raises FormatError for whatever is wrong with it; what the
    C++ reader refuses is refused here."""
    _check(data[:8] == MAGIC, name, "is not a prior file (bad magic number)")
    _check(len(data) >= HEADER.size, name, "is truncated")
    (_, version, header_size, size, checksum, width, height, cameras, flags, _, calibration, key,
     label_space, _) = HEADER.unpack_from(data)
    _check(version == 1, name, f"has format version {version}, this module reads 1")
    _check(header_size == HEADER.size, name, "header size is wrong")
    _check(size == len(data), name, "is truncated or has been extended")
    _check(checksum == zlib.crc32(data[20:]), name, "is corrupt (checksum does not match)")
    _check(1 <= cameras <= 2, name, "camera count is not 1 or 2")
    _check(1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE, name,
           f"image size is not within 1..{MAX_SIDE}")
    label_space = label_space.split(b"\0")[0]
    _check(label_space and all(0x20 < c < 0x7F for c in label_space), name,
           "label space name is empty or not printable")
    _check(flags & ~3 == 0, name, "has unknown frame flags")
    _check(HEADER.size + cameras * CAMERA.size <= len(data), name, "is truncated (camera table)")
    frame = Frame(label_space.decode("ascii"), [], calibration, key, bool(flags & 1),
                  bool(flags & 2))
    for c in range(cameras):
        frame.cameras.append(_decode_camera(data, c, width, height, name))
    return frame


def _check_segments(segments, c, name):
    flags, instance = segments["flags"], segments["instance"]
    _check((segments["label"] != VOID_LABEL).all(), name, "a segment has the void label")
    _check((flags & ~np.uint16(THING | DYNAMIC | RADIAL_ONLY | NOT_JUDGED) == 0).all(), name,
           "a segment has unknown flags")
    _check((flags[flags & RADIAL_ONLY != 0] & DYNAMIC != 0).all(), name,
           "a segment is radial-only but not dynamic")
    _check(((instance >= 0) & ((instance >= RIGHT_INSTANCES) == (c == 1))).all(), name,
           "a segment's instance is not in its camera's range")
    for field_name, most in (("scale", np.inf), ("score", 100)):
        values = segments[field_name]
        _check((np.isfinite(values) & (values >= 0) & (values <= most)).all(), name,
               f"a segment's {field_name} makes no sense")


def _decode_camera(data, c, width, height, name):
    segments_at, count, index_at, runs_at, runs_size = CAMERA.unpack_from(
        data, HEADER.size + c * CAMERA.size)
    _check(count <= MAX_SEGMENTS, name, f"has more than {MAX_SEGMENTS} segments in one camera")
    for at, size in ((segments_at, count * SEGMENT.itemsize), (index_at, 4 * (height + 1)),
                     (runs_at, runs_size)):
        _check(at >= HEADER.size and at + size <= len(data), name, "a table is outside the file")
    segments = np.frombuffer(data, SEGMENT, count, segments_at).copy()
    _check_segments(segments, c, name)
    index = np.frombuffer(data, "<u4", height + 1, index_at).astype(np.int64)
    _check(index[0] == 0 and index[-1] == runs_size and (np.diff(index) >= 0).all(), name,
           "the row table is not increasing from 0 to the size of the runs")
    dynamic = dynamic_by_number(segments)
    segment_map = np.zeros((height, width), np.uint16)
    motion = np.zeros((height, width), np.float32)
    for y in range(height):
        row = _Row(data[runs_at + index[y]:runs_at + index[y + 1]], name)
        x = 0
        while x < width:
            length, segment = row.varint(), row.varint()
            _check(1 <= length <= width - x and segment <= count, name,
                   "a segment run does not fit")
            segment_map[y, x:x + length] = segment
            x += length
        moving = np.flatnonzero(dynamic[segment_map[y]])
        done = 0
        while done < len(moving):
            length, code = row.varint(), row.byte()
            _check(1 <= length <= len(moving) - done, name, "a motion run does not fit")
            motion[y, moving[done:done + length]] = MOTION[code]
            done += length
        _check(row.at == len(row.data), name, "a row has bytes left over")
    area = np.bincount(segment_map.ravel(), minlength=count + 1)[1:]
    _check((area == segments["area"]).all(), name, "a segment's area differs from its runs")
    return Camera(segments, segment_map, motion)


def read(path):
    """Reads a prior file. Raises OSError when there is none, FormatError when it is not sound."""
    if os.path.exists(path):  # a pipe would be waited for
        _check(os.path.isfile(path), path, "is not a regular file")
        _check(os.path.getsize(path) <= MAX_FILE_SIZE, path, "is too large for a prior file")
    with open(path, "rb") as stream:
        return decode(stream.read(), str(path))


def write(path, frame):
    """Writes a prior file atomically. Raises FormatError for whatever readers refuse."""
    data = encode(frame, str(path))
    temporary = f"{path}.{os.getpid()}.tmp"
    try:
        with open(temporary, "wb") as stream:
            stream.write(data)
        os.replace(temporary, path)
    except BaseException:
        if os.path.exists(temporary):
            os.unlink(temporary)
        raise
