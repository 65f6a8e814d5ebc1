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
THING, DYNAMIC, RADIAL_ONLY = 1, 2, 4
RIGHT_INSTANCES = 1 << 30
VOID_LABEL = 0xFFFF
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


def encode(frame):
    """The bytes of a prior file. Motion runs are exact (no tolerance)."""
    if not 1 <= len(frame.cameras) <= 2:
        raise FormatError("a frame has one or two cameras")
    height, width = frame.cameras[0].segment_map.shape
    body_at = HEADER.size + CAMERA.size * len(frame.cameras)
    entries, body = [], bytearray()
    for camera in frame.cameras:
        segments = np.array(camera.segments, dtype=SEGMENT)
        if camera.segment_map.shape != (height, width):
            raise FormatError("the cameras' images differ in size")
        if camera.segment_map.max(initial=0) > len(segments):
            raise FormatError("the map has a segment that is not in the table")
        segments["area"] = np.bincount(camera.segment_map.ravel(), minlength=len(segments) + 1)[1:]
        dynamic = np.concatenate([[False], (segments["flags"] & DYNAMIC) != 0])
        runs, index = bytearray(), []
        for y in range(height):
            index.append(len(runs))
            row = camera.segment_map[y]
            for start, end in zip(*_runs(row)):
                runs += _varint(int(end - start)) + _varint(int(row[start]))
            moving = dynamic[row]
            if moving.any():
                codes = _motion_codes(camera.motion[y][moving])
                for start, end in zip(*_runs(codes)):
                    runs += _varint(int(end - start)) + bytes([codes[start]])
        index.append(len(runs))
        at = body_at + len(body)
        table = segments.tobytes()
        offsets = np.array(index, "<u4").tobytes()
        entries.append(CAMERA.pack(at, len(segments), at + len(table),
                                   at + len(table) + len(offsets), len(runs)))
        body += table + offsets + runs
    size = body_at + len(body)
    header = HEADER.pack(MAGIC, 1, HEADER.size, size, 0, width, height, len(frame.cameras),
                         int(frame.has_motion), 0, frame.calibration_hash, frame.content_key,
                         frame.label_space.encode("ascii"), b"")
    data = bytearray(header + b"".join(entries) + body)
    struct.pack_into("<I", data, 16, zlib.crc32(data[20:]))
    return bytes(data)


def decode(data, name="prior file"):
    """A Frame from the bytes of a file. Raises FormatError for whatever is wrong with it."""
    if data[:8] != MAGIC:
        raise FormatError(f"{name}: is not a prior file (bad magic number)")
    if len(data) < HEADER.size:
        raise FormatError(f"{name}: is truncated")
    (_, version, header_size, size, checksum, width, height, cameras, flags, _, calibration, key,
     label_space, _) = HEADER.unpack_from(data)
    if version != 1 or header_size != HEADER.size:
        raise FormatError(f"{name}: has format version {version}, this module reads 1")
    if size != len(data):
        raise FormatError(f"{name}: is truncated or has been extended")
    if checksum != zlib.crc32(data[20:]):
        raise FormatError(f"{name}: is corrupt (checksum does not match)")
    if not 1 <= cameras <= 2 or not 1 <= width <= 16384 or not 1 <= height <= 16384:
        raise FormatError(f"{name}: image size or camera count makes no sense")
    frame = Frame(label_space.rstrip(b"\0").decode("ascii"), [], calibration, key, bool(flags & 1))
    for c in range(cameras):
        frame.cameras.append(_decode_camera(data, c, width, height, name))
    return frame


def _decode_camera(data, c, width, height, name):
    segments_at, count, index_at, runs_at, runs_size = CAMERA.unpack_from(
        data, HEADER.size + c * CAMERA.size)
    ends = (segments_at + count * SEGMENT.itemsize, index_at + 4 * (height + 1),
            runs_at + runs_size)
    if max(ends) > len(data):
        raise FormatError(f"{name}: a table is outside the file")
    segments = np.frombuffer(data, SEGMENT, count, segments_at).copy()
    index = np.frombuffer(data, "<u4", height + 1, index_at).astype(np.int64)
    if index[0] != 0 or index[-1] != runs_size or (np.diff(index) < 0).any():
        raise FormatError(f"{name}: the row table is not increasing from 0 to the size of the runs")
    dynamic = np.concatenate([[False], (segments["flags"] & DYNAMIC) != 0])
    segment_map = np.zeros((height, width), np.uint16)
    motion = np.zeros((height, width), np.float32)
    for y in range(height):
        row = _Row(data[runs_at + index[y]:runs_at + index[y + 1]], name)
        x = 0
        while x < width:
            length, segment = row.varint(), row.varint()
            if length < 1 or x + length > width or segment > count:
                raise FormatError(f"{name}: a segment run does not fit")
            segment_map[y, x:x + length] = segment
            x += length
        moving = np.flatnonzero(dynamic[segment_map[y]])
        done = 0
        while done < len(moving):
            length, code = row.varint(), row.byte()
            if length < 1 or done + length > len(moving):
                raise FormatError(f"{name}: a motion run does not fit")
            motion[y, moving[done:done + length]] = MOTION[code]
            done += length
        if row.at != len(row.data):
            raise FormatError(f"{name}: a row has bytes left over")
    return Camera(segments, segment_map, motion)


def read(path):
    """Reads a prior file."""
    with open(path, "rb") as stream:
        return decode(stream.read(), str(path))


def write(path, frame):
    """Writes a prior file atomically."""
    data = encode(frame)
    temporary = f"{path}.{os.getpid()}.tmp"
    try:
        with open(temporary, "wb") as stream:
            stream.write(data)
        os.replace(temporary, path)
    except BaseException:
        if os.path.exists(temporary):
            os.unlink(temporary)
        raise
