# SPDX-License-Identifier: BSD-3-Clause
"""Stereo recordings that are no sequence folders: two videos, a video of both images side by side,
ROS 1 and ROS 2 bags (SQLite and MCAP). Frames come out rectified and grey, in order.

    for frame in open_videos("left.mp4", "right.mp4", read_stereo_rig(["camchain.yaml"])):
        slam.feed(frame.left, frame.right, frame.timestamp, name=frame.name)

Needs opencv-python-headless for videos, rosbags for bags.
"""

import contextlib
from collections import deque
from functools import partial
from pathlib import Path
from typing import Deque, Dict, Iterator, List, Optional, Sequence, Tuple

import numpy as np

from ._core import InputError, StereoRig, decode_image, rig_from_camera_info, to_gray
from .files import PathLike
from .pair_frames import PairFrame, Recording, Rig  # noqa: F401
from .videos import _cv2, open_videos  # noqa: F401

VIDEO_SUFFIXES = {".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v", ".mpg", ".mpeg"}
BAG_SUFFIXES = {".bag", ".mcap", ".db3"}


_IMAGE = "sensor_msgs/msg/Image"
_COMPRESSED = "sensor_msgs/msg/CompressedImage"
_CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
_LEFT_WORDS, _RIGHT_WORDS = ("left", "cam0", "infra1", "image_0"), ("right", "cam1", "infra2",
                                                                   "image_1")


def _open_bag(path: PathLike):
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputError("bags need rosbags: pip install rosbags") from None
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if path.is_file() and path.suffix in (".db3", ".mcap") and \
            (path.parent / "metadata.yaml").exists():
        path = path.parent  # a ROS 2 bag is the folder
    with _reading(path, "not a bag that rosbags can read"):
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    return reader


@contextlib.contextmanager
def _reading(path: PathLike, what: str) -> Iterator[None]:
    """Any error as an InputError that names the file: damaged bags raise exceptions of rosbags, of
    what it is built on, and of NumPy."""
    try:
        yield
    except Exception as error:
        lines = str(error).splitlines() or [type(error).__name__]
        raise InputError(f"{path}: {what}: {lines[0]}") from None


def _messages(reader, path: PathLike, connections) -> Iterator[Tuple[int, object, int, object]]:
    """(number from 1, connection, time of reception in ns, message) of the connections' messages."""
    stream = reader.messages(connections)
    number = 0
    while True:
        number += 1
        with _reading(path, f"message {number} cannot be read"):
            found = next(stream, None)
            if found is None:
                return
            connection, received, raw = found
            message = reader.deserialize(raw, connection.msgtype)
        yield number, connection, received, message


def _side(topic: str, words: Tuple[str, ...]) -> bool:
    return any(word in topic.lower() for word in words)


def find_image_topics(reader) -> Tuple[str, str]:
    """The left and the right image topic. Raises InputError with the topics there are."""
    images = [c.topic for c in reader.connections if c.msgtype in (_IMAGE, _COMPRESSED)]
    images = sorted(set(images))
    # image_raw and image_raw/compressed are the same images: the raw ones.
    images = [t for t in images if not (t.endswith("/compressed") and t[:-11] in images)]
    left = [t for t in images if _side(t, _LEFT_WORDS) and not _side(t, _RIGHT_WORDS)]
    right = [t for t in images if _side(t, _RIGHT_WORDS) and not _side(t, _LEFT_WORDS)]
    if len(left) == 1 and len(right) == 1:
        return left[0], right[0]
    if len(images) == 2:
        return images[0], images[1]
    raise InputError("which two image topics? --topics LEFT RIGHT, of: " +
                     (", ".join(images) or "none, this bag has no images"))


def _camera_info(reader, path: PathLike, topic: str) -> Optional[dict]:
    base = topic[:-11] if topic.endswith("/compressed") else topic
    wanted = base.rsplit("/", 1)[0] + "/camera_info"
    connections = [c for c in reader.connections
                   if c.msgtype == _CAMERA_INFO and c.topic == wanted]
    found = None
    for _, _, _, m in _messages(reader, path, connections) if connections else ():
        low = hasattr(m, "k")
        values = {k: list(map(float, getattr(m, k.lower() if low else k))) for k in "DKRP"}
        model = str(m.distortion_model)
        if "rect" in base.rsplit("/", 1)[-1]:  # rectified already: P is all that counts
            p = values["P"]
            values["K"] = [p[0], p[1], p[2], p[4], p[5], p[6], p[8], p[9], p[10]]
            values["D"], values["R"] = [], [1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0]
            model = ""
        found = {"width": int(m.width), "height": int(m.height), "distortion_model": model,
                 "binning_x": int(m.binning_x), "binning_y": int(m.binning_y),
                 "roi": [int(v) for v in (m.roi.x_offset, m.roi.y_offset, m.roi.width, m.roi.height)],
                 **values}
        if any(values["K"]) or any(values["P"]):  # drivers may start before they have a calibration
            break
    return found


# Two bytes per pixel, luma in the one of this number: what most USB cameras send.
_LUMA = {"yuv422": 1, "uyvy": 1, "yuv422_yuy2": 0, "yuyv": 0}
_CHANNELS = {"mono8": 1, "8UC1": 1, "bgr8": 3, "8UC3": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4}


def _decode_image(message, topic: str) -> np.ndarray:
    """(H, W) uint8, or uint16 of an Image message with 16 bits."""
    pixels, is_bgr = _pixels(message, topic)
    return pixels if pixels.ndim == 2 else to_gray(pixels, bgr=is_bgr)


def _colour_of(connection, message) -> Optional[np.ndarray]:
    """(H, W, 3) uint8 RGB of an image message that was read; None: it is grey."""
    if connection.msgtype == _COMPRESSED:
        cv2 = _cv2()
        pixels, is_bgr = cv2.imdecode(np.frombuffer(bytes(message.data), np.uint8), cv2.IMREAD_UNCHANGED), True
        if pixels is None or pixels.dtype != np.uint8 or pixels.ndim != 3:
            return None
    elif message.encoding in _LUMA:
        cv2 = _cv2()
        code = (cv2.COLOR_YUV2RGB_YUY2, cv2.COLOR_YUV2RGB_UYVY)[_LUMA[message.encoding]]
        return cv2.cvtColor(_luma_and_chroma(message, connection.topic), code)
    else:
        pixels, is_bgr = _pixels(message, connection.topic)
    if pixels.ndim == 2:
        return None
    return pixels[:, :, 2::-1] if is_bgr else pixels[:, :, :3]


def _rows(message, topic: str) -> np.ndarray:
    """(H, step) uint8."""
    height, step = int(message.height), int(message.step)
    data = np.asarray(message.data, np.uint8)
    if height < 1 or step < 1 or data.size < height * step:
        raise InputError(f"{topic}: an image message with too few bytes")
    return data[:height * step].reshape(height, step)


def _luma_and_chroma(message, topic: str) -> np.ndarray:
    """(H, W, 2) uint8 of an encoding of _LUMA."""
    height, width, rows = int(message.height), int(message.width), _rows(message, topic)
    if rows.shape[1] < 2 * width:
        raise InputError(f"{topic}: an image message with too few bytes")
    return np.ascontiguousarray(rows[:, :2 * width]).reshape(height, width, 2)


def _pixels(message, topic: str) -> Tuple[np.ndarray, bool]:
    """(H, W) uint8 or uint16, or (H, W, 3) uint8 and whether blue comes first."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    encoding, rows = str(message.encoding), _rows(message, topic)
    if encoding in _LUMA:
        return np.ascontiguousarray(_luma_and_chroma(message, topic)[:, :, _LUMA[encoding]]), False
    if encoding in ("mono16", "16UC1"):
        if step < 2 * width:
            raise InputError(f"{topic}: an image message with too few bytes")
        pixels = np.ascontiguousarray(rows[:, :2 * width]).view(
            ">u2" if message.is_bigendian else "<u2")
        return pixels.astype(np.uint16), False
    if encoding.startswith("bayer_") and encoding.endswith("8"):
        cv2 = _cv2()
        code = {"bayer_rggb8": cv2.COLOR_BayerBG2BGR, "bayer_bggr8": cv2.COLOR_BayerRG2BGR,
                "bayer_gbrg8": cv2.COLOR_BayerGR2BGR, "bayer_grbg8": cv2.COLOR_BayerGB2BGR}
        return cv2.cvtColor(np.ascontiguousarray(rows[:, :width]), code[encoding]), True
    channels = _CHANNELS.get(encoding)
    if channels is None:
        raise InputError(f"{topic}: image encoding '{encoding}' is not supported")
    if step < channels * width:
        raise InputError(f"{topic}: an image message with too few bytes")
    pixels = rows[:, :channels * width].reshape(height, width, channels)
    if channels == 1:
        return pixels[:, :, 0], False
    return pixels[:, :, :3], not encoding.startswith("rgb")


class _InOrder:
    """Puts items of one camera into a queue in the order of their stamps, and counts those out of order.

    Of a stamp that is not above the one before, the next one tells which of the two is wrong: when both
    follow in order on the last but one, the one before was too high, otherwise this one is late. The last
    item of the queue must stay there until then."""

    def __init__(self, queue: Deque, counts: Dict[str, int]) -> None:
        self._queue, self._counts = queue, counts
        self._before = self._newest = -2**63  # stamps of the last two that are in order, ns
        self._held: Optional[Tuple[int, object]] = None

    def put(self, stamp: int, item: object) -> None:
        held, self._held = self._held, None
        if held and self._before < held[0] < stamp <= self._newest:
            self._queue.pop()
            self._counts["out of order"] += 1
            self._newest = self._before
            self._append(*held)
        elif held:
            self._counts["out of order"] += 1
        if stamp > self._newest:
            self._append(stamp, item)
        else:
            self._held = (stamp, item)

    def end(self) -> None:
        """No more items."""
        if self._held:
            self._counts["out of order"] += 1

    def _append(self, stamp: int, item: object) -> None:
        self._before, self._newest = self._newest, stamp
        self._queue.append((stamp, item))


#: images of one camera that wait for the other one at most; a few seconds of both
_MOST_WAITING = 100


def pair_by_time(stream: Iterator[Tuple[int, int, object]], tolerance: float,
                 counts: Dict[str, int], nearest: Optional[List[int]] = None
                 ) -> Iterator[Tuple[int, object, object]]:
    """Pairs of the items of two cameras by time.

    stream: (side 0 or 1, stamp in ns, item), roughly in order.
    tolerance: s, largest difference of the stamps of a pair.
    nearest: gets the smallest difference of two stamps that were compared, ns.
    Yields (left stamp, left item, right item). What has no partner, or one that is nearer to another
    item, is counted, and so is an item whose stamp is out of order: late, or far ahead of those that
    follow it. At most _MOST_WAITING items of a camera wait for the other one; the oldest of more have no
    partner.
    """
    limit = int(round(tolerance * 1e9))
    queues: Tuple[Deque, Deque] = (deque(), deque())
    ordered = tuple(_InOrder(queue, counts) for queue in queues)
    last = None

    def match(least: int):
        nonlocal last
        left, right = queues
        while min(len(left), len(right)) >= least:
            difference = right[0][0] - left[0][0]
            if nearest is not None:
                nearest[:] = [min([abs(difference), *nearest])]
            # A later image may be nearer.
            if len(right) > 1 and abs(right[1][0] - left[0][0]) < abs(difference):
                counts["unmatched right"] += 1
                right.popleft()
            elif len(left) > 1 and abs(right[0][0] - left[1][0]) < abs(difference):
                counts["unmatched left"] += 1
                left.popleft()
            elif difference < -limit:
                counts["unmatched right"] += 1
                right.popleft()
            elif difference > limit:
                counts["unmatched left"] += 1
                left.popleft()
            else:
                stamp, item = left.popleft()
                _, other = right.popleft()
                if last is not None and stamp <= last:
                    counts["out of order"] += 1
                    continue
                last = stamp
                yield stamp, item, other

    def drop_waiting(side: int) -> None:
        """Of a camera that is far ahead of the other one. The other one has one item at most, which stays
        (_InOrder), and so does its partner."""
        queue, other = queues[side], queues[1 - side]
        while len(queue) > _MOST_WAITING:
            apart = [abs(other[0][0] - queue[i][0]) for i in (0, 1)] if other else [limit + 1]
            has_partner = apart[0] <= limit and apart[0] <= apart[1]
            del queue[1 if has_partner else 0]
            counts["unmatched right" if side else "unmatched left"] += 1

    counts.update({"unmatched left": 0, "unmatched right": 0, "out of order": 0})
    for side, stamp, item in stream:
        ordered[side].put(stamp, item)
        # One image of lead, so that a nearer partner may still come.
        yield from match(2)
        drop_waiting(side)
    for camera in ordered:
        camera.end()
    yield from match(1)
    counts["unmatched left"] += len(queues[0])
    counts["unmatched right"] += len(queues[1])


def _without_info(topics: Sequence[str], infos: Sequence[Optional[dict]]) -> str:
    return " and ".join(topic for topic, info in zip(topics, infos) if info is None)


def open_bag(path: PathLike, rig: Optional[StereoRig] = None, *,
             topics: Optional[Sequence[str]] = None, start: int = 0, frames: Optional[int] = None,
             tolerance: float = 0.01) -> Recording:
    """A ROS 1 bag, a ROS 2 bag (folder), or an MCAP file.

    rig: the calibration; None: from the camera_info topics beside the images.
    topics: left and right image topic; None: found by their names.
    tolerance: s, largest difference of the stamps of a pair.
    """
    reader = _open_bag(path)
    left, right = topics if topics else find_image_topics(reader)
    known = {c.topic for c in reader.connections}
    for topic in (left, right):
        if topic not in known:
            raise InputError(f"{path}: has no topic {topic}; it has: {', '.join(sorted(known))}")
    calibration: Optional[Rig] = rig
    if rig is None:
        infos = [_camera_info(reader, path, topic) for topic in (left, right)]
        if None in infos:
            raise InputError(f"{path}: no camera_info beside {_without_info((left, right), infos)}; "
                             "give --calibration")
        calibration = lambda size: rig_from_camera_info(infos, str(path), size)  # noqa: E731
    nearest: List[int] = []
    counts: Dict[str, int] = {}
    connections = [c for c in reader.connections if c.topic in (left, right)]
    for connection in connections:
        if connection.msgtype not in (_IMAGE, _COMPRESSED):
            raise InputError(f"{path}: {connection.topic} carries {connection.msgtype}, not images")

    def stream():
        for number, connection, received, message in _messages(reader, path, connections):
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            yield (0 if connection.topic == left else 1, stamp or received,
                   (number, connection, message))

    def image(item) -> np.ndarray:
        number, connection, message = item
        with _reading(path, f"message {number} cannot be read"):
            if connection.msgtype == _COMPRESSED:
                return decode_image(bytes(message.data), connection.topic)
            return _decode_image(message, connection.topic)

    def pairs():
        for index, (stamp, a, b) in enumerate(pair_by_time(stream(), tolerance, counts, nearest)):
            if index < start:
                continue
            if frames is not None and index >= start + frames:
                return
            yield str(stamp), stamp * 1e-9, image(a), image(b), partial(_colour_of, *a[1:])

    def why_none() -> str:
        text = f": {messages[0]} images of {left}, {messages[1]} of {right}"
        if nearest:
            text += (f"; the nearest are {nearest[0] * 1e-9:.6g} s apart, --tolerance {tolerance:g}"
                     if nearest[0] > round(tolerance * 1e9) else "")
        return text

    messages: List[int] = [sum(c.msgcount for c in connections if c.topic == t)
                           for t in (left, right)]
    size = max(0, min(messages) - start)
    return Recording(Path(path).resolve().stem, "bag", calibration, pairs(),
                     size if frames is None else min(size, frames), counts, start, why_none)
