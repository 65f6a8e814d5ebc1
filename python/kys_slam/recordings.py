# SPDX-License-Identifier: BSD-3-Clause
"""Stereo recordings that are no sequence folders: two videos, a video of both images side by side,
ROS 1 and ROS 2 bags (SQLite and MCAP). Frames come out rectified and grey, in order.

    for frame in open_videos("left.mp4", "right.mp4", read_stereo_rig(["camchain.yaml"])):
        slam.feed(frame.left, frame.right, frame.timestamp, name=frame.name)

Needs opencv-python-headless for videos, rosbags for bags.
"""

import contextlib
import sys
from collections import deque
from pathlib import Path
from typing import Deque, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ._core import (InputError, StereoCamera, StereoRectifier, StereoRig, decode_gray,
                    rig_from_camera_info, to_gray)
from .files import PathLike

VIDEO_SUFFIXES = {".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v", ".mpg", ".mpeg"}
BAG_SUFFIXES = {".bag", ".mcap", ".db3"}


class PairFrame(NamedTuple):
    """A rectified stereo pair."""

    index: int  #: position in the recording, from 0
    name: str
    timestamp: float  #: s
    left: np.ndarray  #: (H, W) uint8
    right: np.ndarray  #: (H, W) uint8


class Recording:
    """Frames of a recording, in order: iterate over it once."""

    def __init__(self, name: str, layout: str, rig: StereoRig, pairs: Iterator,
                 size: Optional[int], counts: Dict[str, int], start: int) -> None:
        """pairs: those from number `start` on."""
        self.name, self.layout = name, layout
        self.ground_truth = None
        self.has_images = True
        self.counts = counts  #: images that were left out, by why
        self._pairs, self._size, self._start = pairs, size, start
        self._first = next(pairs, None)
        if self._first is None:
            raise InputError(f"{name}: holds no stereo pair" + (f" at {start} (start)" if start else ""))
        height, width = self._first[2].shape[:2]
        rig.set_image_size(width, height)
        camera = rig.rectified()
        self._rectifier = None if camera else StereoRectifier(rig)
        self.camera: StereoCamera = camera or self._rectifier.camera

    def __len__(self) -> int:
        return min(self._size or 0, sys.maxsize)  # of a damaged bag, anything

    def __iter__(self) -> Iterator[PairFrame]:
        index = self._start
        first, self._first = self._first, None
        if first is not None:
            yield self._rectified(index, first)
        for pair in self._pairs:
            index += 1
            yield self._rectified(index, pair)

    def _rectified(self, index: int, pair) -> PairFrame:
        name, stamp, left, right = pair
        size = (self.camera.height, self.camera.width)
        for side, image in (("left", left), ("right", right)):
            if image.shape[:2] != size:
                raise InputError(f"{self.name}: frame {name}: the {side} image is "
                                 f"{image.shape[1]}x{image.shape[0]} px, the first one "
                                 f"{size[1]}x{size[0]}")
        if self._rectifier:
            left = self._rectifier.rectify_left(left)
            right = self._rectifier.rectify_right(right)
        return PairFrame(index, name, stamp, left, right)


# Videos

def _cv2():
    try:
        import cv2
    except ImportError:
        raise InputError("videos need OpenCV: pip install opencv-python-headless") from None
    return cv2


def _open_video(path: PathLike):
    cv2 = _cv2()
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file")
    video = cv2.VideoCapture(str(path))
    if not video.isOpened():
        raise InputError(f"{path}: not a video that OpenCV can read")
    return video


def _video_rate(video, path: PathLike, rate: Optional[float]) -> float:
    value = rate or video.get(_cv2().CAP_PROP_FPS)
    if not value or not np.isfinite(value) or value <= 0 or value > 1e5:
        raise InputError(f"{path}: does not say its frame rate; give --rate")
    return float(value)


def _video_length(video) -> int:
    """Frames, as the header counts them; 0: it does not."""
    value = video.get(_cv2().CAP_PROP_FRAME_COUNT)
    return int(value) if 0 < value < 2**31 else 0


def _check_same_rate(paths, videos, lengths) -> None:
    """Raises InputError when the frames of one number are not of one moment, by the rates of two videos.
    Rates that containers measure are right to a frame in the length of the video."""
    rates = [v.get(_cv2().CAP_PROP_FPS) for v in videos]
    if len(videos) < 2 or not all(np.isfinite(r) and 0 < r <= 1e5 for r in rates):
        return
    shared = min(lengths)
    if abs(rates[1] / rates[0] - 1) <= max(5e-4, 1 / shared if shared else 0):
        return
    raise InputError(f"{paths[1]}: {rates[1]:.6g} frames per second, {paths[0]} has {rates[0]:.6g}, and "
                     "frames are paired by number; give --rate when frames of one number are of one "
                     "moment all the same")


def open_videos(left: PathLike, right: Optional[PathLike], rig: StereoRig, *, start: int = 0,
                frames: Optional[int] = None, rate: Optional[float] = None) -> Recording:
    """Two videos of the same frames, or one (`right` None) with both images side by side.

    rate: frames per second; None: as the left video says. Frames are paired by number: two videos whose
    rates differ by more than 0.05 %, and by more than one frame in the whole length, are an InputError
    unless `rate` is given.

    A video that ends more than one frame before the number that its header counts is an InputError,
    after the frames before. One frame is counted: some containers state their duration alone.
    """
    paths = [left] if right is None else [left, right]
    videos = [_open_video(path) for path in paths]
    fps = _video_rate(videos[0], left, rate)
    lengths = [_video_length(v) for v in videos]
    if not rate:
        _check_same_rate(paths, videos, lengths)
    counts = {"frames of the longer video": max(lengths) - min(lengths) if all(lengths) else 0,
              "frames that a video does not hold": 0}

    def check_end(path: PathLike, length: int, index: int) -> None:
        if length - index > 1:
            raise InputError(f"{path}: damaged or truncated: frame {index} cannot be read, the header "
                             f"counts {length}")
        counts["frames that a video does not hold"] += length - index == 1

    def pairs():
        index = -1
        while frames is None or index + 1 < start + frames:
            read = [v.read() for v in videos]
            index += 1
            if not all(ok for ok, _ in read):
                for path, length, (ok, _) in zip(paths, lengths, read):
                    if not ok:
                        check_end(path, length, index)
                return
            if index < start:
                continue
            images = [image for _, image in read]
            if len(images) == 1:
                half = images[0].shape[1] // 2
                images = [images[0][:, :half], images[0][:, half:2 * half]]
            yield (f"{index:06d}", index / fps, *(to_gray(i, bgr=True) for i in images))

    size = max(0, min(lengths) - start)
    return Recording(Path(left).resolve().stem, "video pair", rig, pairs(),
                     size if frames is None else min(size, frames), counts, start)


# Bags

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
    # image_raw and image_raw/compressed are the same pictures: the raw ones.
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
    for _, _, _, m in _messages(reader, path, connections) if connections else ():
        low = hasattr(m, "k")
        values = {k: list(map(float, getattr(m, k.lower() if low else k))) for k in "DKRP"}
        if "rect" in base.rsplit("/", 1)[-1]:  # rectified already: P is all that counts
            p = values["P"]
            values["K"] = [p[0], p[1], p[2], p[4], p[5], p[6], p[8], p[9], p[10]]
            values["D"], values["R"] = [], [1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0]
        return {"width": int(m.width), "height": int(m.height),
                "distortion_model": str(m.distortion_model), **values}
    return None


_CHANNELS = {"mono8": 1, "8UC1": 1, "bgr8": 3, "8UC3": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4}


def _decode_image(message, topic: str) -> np.ndarray:
    """(H, W) uint8 of an Image message."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    encoding, data = str(message.encoding), np.asarray(message.data, np.uint8)
    if height < 1 or step < 1 or data.size < height * step:
        raise InputError(f"{topic}: an image message with too few bytes")
    rows = data[:height * step].reshape(height, step)
    if encoding in ("mono16", "16UC1"):
        if step < 2 * width:
            raise InputError(f"{topic}: an image message with too few bytes")
        high = 0 if message.is_bigendian else 1
        return np.ascontiguousarray(rows[:, high:2 * width:2])
    if encoding.startswith("bayer_") and encoding.endswith("8"):
        cv2 = _cv2()
        code = {"bayer_rggb8": cv2.COLOR_BayerBG2BGR, "bayer_bggr8": cv2.COLOR_BayerRG2BGR,
                "bayer_gbrg8": cv2.COLOR_BayerGR2BGR, "bayer_grbg8": cv2.COLOR_BayerGB2BGR}
        return to_gray(cv2.cvtColor(np.ascontiguousarray(rows[:, :width]), code[encoding]),
                       bgr=True)
    channels = _CHANNELS.get(encoding)
    if channels is None:
        raise InputError(f"{topic}: image encoding '{encoding}' is not supported")
    if step < channels * width:
        raise InputError(f"{topic}: an image message with too few bytes")
    pixels = rows[:, :channels * width].reshape(height, width, channels)
    if channels == 1:
        return pixels[:, :, 0]
    return to_gray(pixels[:, :, :3], bgr=not encoding.startswith("rgb"))


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
                 counts: Dict[str, int]) -> Iterator[Tuple[int, object, object]]:
    """Pairs of the items of two cameras by time.

    stream: (side 0 or 1, stamp in ns, item), roughly in order.
    tolerance: s, largest difference of the stamps of a pair.
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
    if rig is None:
        infos = [_camera_info(reader, path, topic) for topic in (left, right)]
        if None in infos:
            raise InputError(f"{path}: no camera_info beside {left} and {right}; "
                             "give --calibration")
        rig = rig_from_camera_info(infos, str(path))
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
                return decode_gray(bytes(message.data), connection.topic)
            return _decode_image(message, connection.topic)

    def pairs():
        for index, (stamp, a, b) in enumerate(pair_by_time(stream(), tolerance, counts)):
            if index < start:
                continue
            if frames is not None and index >= start + frames:
                return
            yield str(stamp), stamp * 1e-9, image(a), image(b)

    messages: List[int] = [sum(c.msgcount for c in connections if c.topic == t)
                           for t in (left, right)]
    size = max(0, min(messages) - start)
    return Recording(Path(path).resolve().stem, "bag", rig, pairs(),
                     size if frames is None else min(size, frames), counts, start)
