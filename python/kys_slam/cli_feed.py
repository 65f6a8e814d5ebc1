# SPDX-License-Identifier: BSD-3-Clause
"""Feeds a recording to the system: progress, checks of the pairs, masks."""

import sys
import time
from typing import Callable, List

import kys_slam
from kys_slam import InputError
from kys_slam.cli_errors import warn


class _Progress:
    """A bar on a terminal, a line now and then elsewhere."""

    def __init__(self, total: int, quiet: bool) -> None:
        self.total, self.quiet, self.bar = total, quiet, sys.stderr.isatty()
        self.last = self.start = time.monotonic()

    def update(self, done: int) -> None:
        now = time.monotonic()
        if self.quiet or now - self.last < (0.2 if self.bar else 10):
            return
        self.last = now
        of = f" of {self.total}" if self.total else ""
        rate = done / max(1e-6, now - self.start)
        text = f"tracking: frame {done}{of}, {rate:.1f} per second"
        print("\r\x1b[K" + text if self.bar else text, end="" if self.bar else "\n",
              file=sys.stderr, flush=True)

    def end(self) -> None:
        if self.bar and not self.quiet:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


class _PairWatch:
    """Tells once when left and right images do not belong together, as the other programs do."""

    def __init__(self) -> None:
        self.history = kys_slam.PairHistory()

    def check(self, frame) -> None:
        before = self.history.warning
        if self.history.count_frame() and frame.left is not None:
            self.history.check(frame.left, frame.right, frame.index)
        self._tell(before)

    def finish(self) -> list:
        """All messages."""
        before = self.history.warning
        self.history.finish()
        self._tell(before)
        return [self.history.warning] if self.history.warning else []

    def _tell(self, before: str) -> None:
        if self.history.warning != before:
            warn(self.history.warning)


def _check_pair(frame) -> None:
    check = kys_slam.check_stereo_pair(frame.left, frame.right)
    if check.problem:
        raise InputError(f"frame {frame.name}: {check.problem} (--no-check to go on)")


class Feed:
    """Feeds the frames of a recording to a system."""

    def __init__(self, args, slam, masks, fixed, notes: List[str], total: int,
                 segmenter=None) -> None:
        """masks: MaskFolder or None. fixed: FixedMasks or None. notes: warnings about the recording.
        segmenter: Segmenter or None."""
        self.args, self.slam, self.masks, self.fixed, self.notes = args, slam, masks, fixed, notes
        for note in notes:
            warn(note)
        self.progress, self.watch = _Progress(total, args.quiet), _PairWatch()
        self.segmenter = segmenter
        self.done, self._told = 0, set()

    def all(self, frames, interrupted: Callable[[], bool]) -> None:
        """Feeds them all, or those before `interrupted` says True."""
        for frame in frames:
            if interrupted():
                return
            if self.done == 0 and not self.args.no_check and frame.left is not None:
                _check_pair(frame)
            self._feed(frame)
            self.done += 1
            self.progress.update(self.done)

    def _feed(self, frame) -> None:
        self.watch.check(frame)
        mask = self.masks(frame.name) if self.masks else None
        if self.masks and self.masks.warning:
            self._tell(self.masks.warning)
        segments = None
        if mask and self.masks.classes:
            segments, mask = self.masks.priors(mask), self.masks.without_classes(mask)
        if self.fixed:
            mask = self.fixed.add_to(mask)
        if self.segmenter:
            self.segmenter.offer(frame)
        if isinstance(frame, kys_slam.StereoFrame):
            report = self.slam.feed_frame(frame, segments, mask)
        else:
            report = self.slam.feed(frame.left, frame.right, frame.timestamp, segments, mask,
                                    name=frame.name, index=frame.index)
        if self.segmenter:
            self.segmenter.fed()
            if self.segmenter.error:
                self._tell(self.segmenter.error + "; the run goes on without segments")
        if report.warning:
            self._tell(report.warning, f"frame {report.index}: ")

    def _tell(self, warning: str, where: str = "") -> None:
        """Each warning once."""
        if warning not in self._told:
            self._told.add(warning)
            warn(where + warning)

    def finish(self) -> list:
        """All warnings that a run's summary has."""
        others = [source.warning for source in (self.masks,) if source and source.warning]
        others += [self.segmenter.error] if self.segmenter and self.segmenter.error else []
        return self.notes + self.watch.finish() + others
