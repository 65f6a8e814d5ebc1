# SPDX-License-Identifier: BSD-3-Clause
"""Stereo videos: two files, or one with both images side by side."""

from functools import partial
from itertools import islice
from pathlib import Path
from typing import Dict, Iterator, Optional, Tuple

import numpy as np

from ._core import InputError, StereoRig, to_gray
from .files import PathLike
from .pair_frames import Recording

#: frames that tell whether a video has a constant rate
_FRAMES_OF_RATE = 100
#: s, by which times of containers differ from those of a constant rate: Matroska has whole ms
_ROUNDING = 0.0015


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


def _video_length(video) -> int:
    """Frames, as the header counts them; 0: it does not."""
    value = video.get(_cv2().CAP_PROP_FRAME_COUNT)
    return int(value) if 0 < value < 2**31 else 0


def _check_same_rate(videos) -> None:
    """Raises InputError when the frames of one number are not of one moment, by the rates of two videos.
    Rates that containers measure are right to a frame in the length of the video."""
    if len(videos) < 2:
        return
    rates, paths = [v.fps for v in videos], [v.path for v in videos]
    shared = min(v.length for v in videos)
    if abs(rates[1] / rates[0] - 1) <= max(5e-4, 1 / shared if shared else 0):
        return
    if any(_is_variable(path) for path in paths):  # by time, then
        return
    raise InputError(f"{paths[1]}: {rates[1]:.6g} frames per second, {paths[0]} has {rates[0]:.6g}, and "
                     "frames are paired by number; give --rate when frames of one number are of one "
                     "moment all the same")


def _is_variable(path: PathLike) -> bool:
    """Whether the first frames are not those of a constant rate."""
    video = _Video(path, None)
    for _ in range(_FRAMES_OF_RATE):
        if video.variable or video.read() is None:
            break
    return video.variable


class _Video:
    """The frames of one video, in order, with their times."""

    def __init__(self, path: PathLike, rate: Optional[float]) -> None:
        """rate: frames per second; None: the times are those of the container."""
        self.path, self._rate = path, rate
        self._video = _open_video(path)
        self.length = _video_length(self._video)
        self.header_rate = self._video.get(_cv2().CAP_PROP_FPS)
        self.fps = rate or self.header_rate
        self.number = -1  #: of the last frame read
        self.time = 0.0  #: of the last frame read, s
        self.variable = False  #: whether times are not those of a constant rate
        self.ended = False
        self._has_stamps = True
        if not np.isfinite(self.fps) or not 0 < self.fps <= 1e5:
            raise InputError(f"{path}: does not say its frame rate; give --rate")

    def read(self) -> Optional[np.ndarray]:
        """The next frame; None at the end."""
        good, image = self._video.read()
        self.number += 1
        if not good:
            self.ended = True
            return None
        before, self.time = self.time, self._time()
        if self.number > 0 and self.time <= before:
            self.time = before + 1 / self.fps
        return image

    def _time(self) -> float:
        """That of the container, where it says another time than the rate does. Containers without times say 0."""
        constant = self.number / self.fps
        if self._rate or not self._has_stamps:
            return constant
        stamp = self._video.get(_cv2().CAP_PROP_POS_MSEC) / 1000
        if not np.isfinite(stamp) or (self.number > 0 and stamp <= 0):
            self._has_stamps = False
            return constant
        self.variable = self.variable or abs(stamp - constant) > _ROUNDING
        return stamp if self.variable else constant


def _rgb(image: np.ndarray) -> np.ndarray:
    return image[:, :, ::-1]


def _pairs_of(videos, counts: Dict[str, int]) -> Iterator[Tuple[int, float, list]]:
    """(number and time of the left frame, images). Frames are paired by number, from the first one on
    whose time is not that of a constant rate by time after the first frame."""
    if len(videos) == 1:
        while (image := videos[0].read()) is not None:
            half = image.shape[1] // 2
            yield videos[0].number, videos[0].time, [image[:, :half], image[:, half:2 * half]]
        return
    left, right = videos
    images = [v.read() for v in videos]
    while all(image is not None for image in images):
        late = left.time - right.time
        if (left.variable or right.variable) and abs(late) > 0.5 / left.fps:
            side = 0 if late < 0 else 1
            counts["unmatched right" if side else "unmatched left"] += 1
            images[side] = videos[side].read()
            continue
        yield left.number, left.time, images
        images = [v.read() for v in videos]


def open_videos(left: PathLike, right: Optional[PathLike], rig: StereoRig, *, start: int = 0,
                frames: Optional[int] = None, rate: Optional[float] = None) -> Recording:
    """Two videos of the same frames, or one (`right` None) with both images side by side.

    rate: frames per second; None: the times that the videos have. Frames are paired by number, those of
    videos whose times are not of a constant rate by their times; with `rate` always by number. Two videos
    of constant rates that differ by more than 0.05 %, and by more than one frame in the whole length, are
    an InputError unless `rate` is given.

    A video that ends more than one frame before the number that its header counts is an InputError,
    after the frames before. One frame is counted: some containers state their duration alone.
    """
    paths = [left] if right is None else [left, right]
    videos = [_Video(path, rate) for path in paths]
    lengths = [v.length for v in videos]
    if not rate:
        _check_same_rate(videos)
    counts = {"unmatched left": 0, "unmatched right": 0,
              "frames of the longer video": max(lengths) - min(lengths) if all(lengths) else 0,
              "frames that a video does not hold": 0}

    def check_end(video: _Video) -> None:
        missing = video.length - video.number
        if missing > 1:
            raise InputError(f"{video.path}: damaged or truncated: frame {video.number} cannot be read, "
                             f"the header counts {video.length}")
        counts["frames that a video does not hold"] += missing == 1

    def pairs():
        end = None if frames is None else start + frames
        for number, time, images in islice(_pairs_of(videos, counts), start, end):
            yield (f"{number:06d}", time, *(to_gray(i, bgr=True) for i in images),
                   partial(_rgb, images[0]))
        for video in videos:
            if video.ended:
                check_end(video)

    size = max(0, min(lengths) - start)
    return Recording(Path(left).resolve().stem, "video pair", rig, pairs(),
                     size if frames is None else min(size, frames), counts, start,
                     lambda: ": " + ", ".join(f"{v.path} has {v.number} frames" for v in videos))
