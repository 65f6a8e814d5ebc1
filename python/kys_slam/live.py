# SPDX-License-Identifier: BSD-3-Clause
"""Frames that come when they come: between a camera and a system that may be slower.

    frames = FrameQueue("drop-oldest")
    camera.on_frame(lambda left, right, time: frames.put((left, right, time)))   # another thread
    for left, right, time in frames:
        slam.feed(left, right, time)
    print(frames.dropped, "frames came too fast")
"""

import threading
import time
from collections import deque
from typing import Any, Deque, Iterable, Iterator, Optional

from ._core import InputError

POLICIES = ("wait", "drop-oldest", "drop-newest")
LONGEST_PAUSE = 60.0  #: s; a longer gap between time stamps is played as a pause of this length


class FrameQueue:
    """A bounded queue of frames, written by one thread and read by another.

    policy: what happens to a frame that comes while `capacity` frames wait: "wait" holds the writer
        up (right for recordings), "drop-oldest" drops the one that waits longest (the pose is
        always that of a recent frame), "drop-newest" drops the one that comes (those that wait
        follow each other closely).
    """

    def __init__(self, policy: str = "drop-oldest", capacity: int = 2) -> None:
        if policy not in POLICIES:
            raise InputError(f"'{policy}' is no policy: " + ", ".join(POLICIES))
        if capacity < 1:
            raise InputError("a queue holds at least one frame")
        self.policy, self.capacity = policy, capacity
        self.received = 0  #: frames given to put()
        self.dropped = 0  #: of these, never handed out
        self._frames: Deque[Any] = deque()
        self._changed = threading.Condition()
        self._closed = False
        self._error: Optional[BaseException] = None

    def put(self, frame: Any) -> bool:
        """Whether the frame was taken. False: it was dropped, or the queue is closed."""
        with self._changed:
            if self.policy == "wait":
                self._changed.wait_for(lambda: self._closed or len(self._frames) < self.capacity)
            if self._closed:
                return False
            self.received += 1
            if len(self._frames) >= self.capacity:
                self.dropped += 1
                if self.policy == "drop-newest":
                    return False
                self._frames.popleft()
            self._frames.append(frame)
            self._changed.notify_all()
            return True

    def close(self, error: Optional[BaseException] = None) -> None:
        """No more frames; those that wait are still handed out. error: raised after them."""
        with self._changed:
            self._closed, self._error = True, self._error or error
            self._changed.notify_all()

    def __iter__(self) -> Iterator[Any]:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._frames)
                if not self._frames:
                    if self._error:
                        raise self._error
                    return
                frame = self._frames.popleft()
                self._changed.notify_all()
            yield frame


class Playback:
    """A recording at the pace of its time stamps: iterate over it once. Frames are read in a thread
    of its own. A frame is handed out at its time or, when the reader of this is late, as the policy
    of FrameQueue says. Gaps of more than LONGEST_PAUSE are shortened."""

    def __init__(self, recording: Iterable[Any], policy: str = "wait", capacity: int = 2,
                 speed: float = 1.0, stall_ms: float = 0.0) -> None:
        """speed: 2 plays twice as fast as recorded.
        stall_ms: ms by which each frame comes later after the one before: the setting
            control.stall_ms of the system that is fed, which sleeps that long in every frame. The time
            is added to the pace, as in the C++ programs; otherwise it vanishes in the wait for the next
            frame, or frames are dropped for it.
        """
        self._recording, self._speed, self._stall_s = recording, speed, stall_ms / 1000
        self._queue = FrameQueue(policy, capacity)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._play, name="playback", daemon=True)

    @property
    def dropped(self) -> int:
        """Frames that came while too many waited."""
        return self._queue.dropped

    def stop(self) -> None:
        """No more frames but those that wait. From any thread."""
        self._stop.set()
        self._queue.close()

    def __iter__(self) -> Iterator[Any]:
        self._thread.start()
        try:
            yield from self._queue
        finally:
            self.stop()
            self._thread.join()

    def _play(self) -> None:
        error, offset = None, None
        try:
            for number, frame in enumerate(self._recording):
                due = frame.timestamp / self._speed + number * self._stall_s
                now = time.monotonic()
                latest = now + LONGEST_PAUSE + self._stall_s
                offset = now - due if offset is None else min(offset, latest - due)
                if self._stop.wait(max(0, due + offset - now)):
                    break
                self._queue.put(frame)
        except BaseException as what:  # raised where the frames are read
            error = what
        self._queue.close(error)
