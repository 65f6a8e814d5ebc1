# SPDX-License-Identifier: BSD-3-Clause
"""What the system sees, shown while it runs or recorded for later.

    recorder = open_recorder("run.rrd", slam)              # or run.mcap, or VIEWER
    ...                                                    # feed frames, finish()
    recorder.close()

.rrd files and the live view are Rerun's (rerun-sdk), .mcap files hold Foxglove's schemas
(mcap-protobuf-support, foxglove-schemas-protobuf). The thread that feeds copies keypoints and shares
the image, nothing else: a thread of the pipe makes it a JPEG, drawing happens in a process of its own
(kys_slam.record_process). Recording changes no result.
"""

import fcntl
import json
import os
import pickle
import struct
import subprocess
import sys
from typing import List

from ._core import FrameReport, InputError, _ObservationPipe
from .drawing import End, LoopSeen
from .files import PathLike
from .system import System

VIEWER = "viewer"  #: the target of open_recorder that shows instead of writing
_PIPE_BYTES = 1 << 20
_JPEG_QUALITY = 80
# Files are closed when main() returns; taking down the interpreter would take 0.1 s more.
_CHILD = ("import sys, os, json; sys.path[:] = json.loads(sys.argv[1]); "
          "from kys_slam.record_process import main; os._exit(main())")


class Recorder:
    """Frames on their way to a process that draws them. Made by open_recorder."""

    def __init__(self, target: str, slam: System, images: bool) -> None:
        self.target, self._slam, self._open = target, slam, True
        #: processor time that drawing took in its process, start-up apart, s; known after close()
        self.drawing_s = 0.0
        self._child = subprocess.Popen(
            [sys.executable, "-c", _CHILD, json.dumps(sys.path)], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, start_new_session=True)  # Ctrl-C is for this process
        camera = {key: getattr(slam.camera, key) for key in
                  ("width", "height", "fx", "fy", "cx", "cy", "baseline")}
        self._send({"target": target, "camera": camera,
                    "label_space": slam.settings.get("control.label_space"),
                    "priors": None if slam.priors is None else os.fspath(slam.priors)})
        try:
            self._wait_for("ready")
        except BaseException:
            self._child.kill()
            self._end_child()
            raise
        descriptor = self._child.stdin.fileno()
        if hasattr(fcntl, "F_SETPIPE_SZ"):
            try:
                fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
            except OSError:
                pass  # a smaller one does as well
        self._pipe = _ObservationPipe(descriptor, wait=target != VIEWER,
                                      jpeg_quality=_JPEG_QUALITY if images else 0)
        slam._add_pipe(self._pipe)

    @property
    def failed(self) -> bool:
        """The recording cannot be written any more; close() says why."""
        return self._open and self._pipe.broken

    @property
    def skipped(self) -> int:
        """Frames that were not shown, because the viewer was behind. Files have all."""
        return self._pipe.skipped

    def close(self) -> None:
        """Ends the recording. After the system's finish(): what came of it is drawn too.
        Raises InputError when the recording cannot be written."""
        if not self._open:
            return
        self._open = False
        slam = self._slam
        try:
            slam._remove_pipe(self._pipe)
            self._pipe.finish()
            error = self._pipe.error
            if error or not self._pipe.broken:
                self._send(End(slam.trajectory(), slam.snapshot(), slam.objects(),
                               _loops(slam.reports())))
            self.drawing_s = self._wait_for("done")["drawing_s"]
            if error:
                raise InputError(f"{self.target}: frames are missing: {error}")
        except BaseException:
            self._child.kill()  # it may wait for more: the pipe has its input open as well
            raise
        finally:
            self._end_child()

    def discard(self) -> None:
        """Ends the recording and removes its file."""
        if not self._open:
            return
        self._open = False
        self._slam._remove_pipe(self._pipe)
        self._child.kill()
        self._pipe.finish()
        self._end_child()
        _remove_file(self.target)

    def _end_child(self) -> None:
        try:
            self._child.stdin.close()
        except BrokenPipeError:
            pass
        self._child.wait()
        self._child.stdout.close()

    def _send(self, what) -> None:
        data = pickle.dumps(what, pickle.HIGHEST_PROTOCOL)
        try:
            self._child.stdin.write(b"P" + struct.pack("<Q", len(data)) + data)
            self._child.stdin.flush()
        except BrokenPipeError:
            pass  # the child says why

    def _wait_for(self, state: str) -> dict:
        line = self._child.stdout.readline()
        try:
            answer = json.loads(line)
        except ValueError:
            raise InputError(f"{self.target}: cannot be recorded: the process that writes it ended "
                             f"with status {self._child.wait()}") from None
        if answer.get("state") != state:
            error = answer.get("error", "cannot be recorded")
            raise InputError(error if self.target in error else f"{self.target}: {error}")
        return answer


def _remove_file(target: str) -> None:
    """Not what is no file of its own: a device, a link."""
    if target != VIEWER and os.path.isfile(target) and not os.path.islink(target):
        os.unlink(target)


def _loops(reports: List[FrameReport]) -> List[LoopSeen]:
    fed_as = {r.index: i for i, r in enumerate(reports)}
    return [LoopSeen(r.index, r.loop_frame, fed_as[r.index], fed_as.get(r.loop_frame, -1),
                     r.timestamp, r.loop, r.loop_gap_m)
            for r in reports if r.loop in ("closed", "merged")]


def open_recorder(target: PathLike, slam: System, images: bool = True) -> Recorder:
    """Records what `slam` is fed from now on to FILE.rrd or FILE.mcap, or shows it in Rerun's
    viewer (VIEWER).

    images: JPEGs of the left camera go along.
    Raises InputError when the file cannot be written, or a package is missing that it needs.
    """
    target = os.fspath(target)
    if target != VIEWER and not target.endswith((".rrd", ".mcap")):
        raise InputError(f"{target}: recordings are FILE.rrd or FILE.mcap")
    return Recorder(target, slam, images)
