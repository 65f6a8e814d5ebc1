# SPDX-License-Identifier: BSD-3-Clause
"""Segmentation beside the tracker: any function from the frame to its segments, in a thread of its own.

    with Segmenter(slam, lambda frame: my_segments(frame.left), every=1) as segmenter:
        for frame in recording:
            segmenter.offer(frame)
            slam.feed(frame.left, frame.right, frame.timestamp)
            segmenter.fed()

The function is called for some frames, in order, and returns a PriorFrame (its left camera counts), or
None: this frame has none. With the schedules "sequential" and "pipelined" these are frames 0, every,
2 every, ... and results do not depend on how long it takes (System.add_segments). With "realtime" frames
that come while it is busy are skipped. Where it raises, the run goes on without.
"""

import queue
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, Optional

from ._core import InputError
from .files import PathLike
from .priors import PriorFrame, encode_prior, read_prior, write_prior
from .system import System

Function = Callable[[Any], Optional[PriorFrame]]

_LONGEST_END = 5.0  # s, a function that runs is waited for at the end


class Segmenter:
    """Calls a function for frames that are fed, in a thread, and gives the system what it returns."""

    def __init__(self, slam: System, function: Function, every: int = 1, realtime: bool = False,
                 save: Optional[PathLike] = None) -> None:
        """every: frames between segmentations: control.segment_every of the system, for "realtime" at
            least that many.
        realtime: the schedule of the system is "realtime".
        save: folder for prior files of what is used; None: none are written.
        """
        self._slam, self._function, self._every, self._realtime = slam, function, every, realtime
        self._save = Path(save) if save is not None else None
        self._frames: "queue.Queue[Any]" = queue.Queue()
        self._idle = threading.Event()
        self._idle.set()
        self._count = 0
        self._thread = threading.Thread(target=self._work, name="segmentation", daemon=True)
        self.error = ""  #: why there are no more segments; "": there are
        self.segmented = 0  #: frames
        self.skipped = 0  #: frames that came while it was busy ("realtime")
        self.seconds = 0.0  #: in the function

    def __enter__(self) -> "Segmenter":
        self._thread.start()
        return self

    def __exit__(self, *error: Any) -> None:
        self.close()

    def offer(self, frame: Any) -> None:
        """The next frame, before it is fed."""
        if self._count % self._every == 0 and not self.error:
            if self._realtime and not self._idle.is_set():
                self.skipped += 1
            else:
                self._idle.clear()
                self._frames.put((self._count, frame))

    def fed(self) -> None:
        """It is fed: frames are numbered by those the system has taken."""
        self._count += 1

    def close(self) -> None:
        """Ends the thread; a function that hangs is left behind. Waits of the system end."""
        self._slam.end_segments()
        self._frames.put(None)
        if self._thread.is_alive():
            self._thread.join(_LONGEST_END)

    def _work(self) -> None:
        while True:
            item = self._frames.get()
            if item is None:
                return
            index, frame = item
            try:
                began = time.monotonic()
                segments = self._function(frame)
                self.seconds += time.monotonic() - began
                if segments is not None and self._save is not None:
                    write_prior(self._save / f"{frame.name}.kysp", segments)
                self._slam.add_segments(index, segments)
                self.segmented += segments is not None
            except Exception as error:  # of the function: anything
                lines = str(error).splitlines() or [type(error).__name__]
                self.error = f"segmentation of frame {frame.name} failed: {lines[0]}"
                self._slam.end_segments()
                return
            finally:
                if self._frames.empty():
                    self._idle.set()


def from_folder(folder: PathLike) -> Function:
    """The prior files of a folder, by the names of frames, in place of a network."""
    folder = Path(folder)
    if not any(folder.glob("*.kysp")):
        raise InputError(f"{folder}: has no prior files (*.kysp)")

    def read(frame: Any) -> Optional[PriorFrame]:
        file = folder / f"{frame.name}.kysp"
        return read_prior(file) if file.exists() else None

    return read
