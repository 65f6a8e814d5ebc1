# SPDX-License-Identifier: BSD-3-Clause
"""The process that draws and writes a recording: frames come in by its standard input, what became
of it goes out as lines of JSON (kys_slam.record starts it)."""

import json
import os
import pickle
import struct
import sys
import time
from pathlib import Path
from typing import BinaryIO, Optional, Tuple

import numpy as np

from ._core import InputError, LabelSpace, StereoCamera
from .drawing import Artist, End, Seen, Segments, Sink
from .record import VIEWER


def read_message(stream: BinaryIO) -> Optional[Tuple[bytes, bytes]]:
    """Kind (b"P": a pickle, b"F": a frame) and content; None at the end, also of a broken one."""
    head = stream.read(9)
    if len(head) < 9:
        return None
    size = struct.unpack("<Q", head[1:])[0]
    content = stream.read(size)
    return (head[:1], content) if len(content) == size else None


def decode_frame(content: bytes) -> Tuple[Seen, bytes]:
    """What was seen, and the bytes of the prior file that came with the frame (python/src/
    observation_pipe.cpp writes them)."""
    size = struct.unpack_from("<I", content)[0]
    report = json.loads(content[4:4 + size])
    at, n = 4 + size, report["n"]

    def take(kind: str, count: int) -> np.ndarray:
        nonlocal at
        values = np.frombuffer(content, kind, count, at)
        at += values.nbytes
        return values

    priors = report["priors"]
    keypoints, depths = take("<f4", 2 * n).reshape(n, 2), take("<f4", n)
    instances, motions, labels = take("<i4", priors), take("<f4", priors), take("<u2", priors)
    tiers = take("u1", n)
    jpeg = take("u1", report["jpeg"]).tobytes() or None
    segments = take("u1", report["segments"]).tobytes()
    p_moving = {i[0]: i[2] for i in report["instances"]}
    if not priors:
        labels = instances = motions = None
    return Seen(report, keypoints, depths, tiers, labels, instances, motions, p_moving, jpeg), segments


def _open_sink(target: str) -> Sink:
    if target.endswith(".mcap"):
        from .record_mcap import McapSink
        return McapSink(target)
    from .record_rerun import RerunSink
    return RerunSink(None if target == VIEWER else target)


def _prior_of(name: str, given: bytes, folder: Optional[str]) -> Optional[Segments]:
    """The system has read the file already and said what is wrong with it."""
    try:
        if given:
            return Segments.decode(given)
        return Segments.decode((Path(folder) / f"{name}.kysp").read_bytes()) if folder else None
    except (InputError, OSError):
        return None


def _record(stream: BinaryIO, say) -> float:
    """Returns the processor time of drawing, s."""
    config = pickle.loads(read_message(stream)[1])
    sink = _open_sink(config["target"])
    camera = StereoCamera(**config["camera"])
    classes = LabelSpace(config["label_space"]).names
    artist = Artist(camera, classes)
    try:
        sink.start(camera)
        if config["target"] != VIEWER:
            os.nice(10)  # from now on tracking goes first
        say({"state": "ready"})
        began = time.process_time()
        while message := read_message(stream):
            kind, content = message
            if kind == b"F":
                seen, given = decode_frame(content)
                prior = _prior_of(seen.report["name"], given, config["priors"])
                sink.frame(artist.draw(seen, prior))
            else:
                end = pickle.loads(content)
                assert isinstance(end, End)
                sink.end(artist.draw_end(end), classes)
                break
    finally:
        sink.close()
    return time.process_time() - began


def main() -> int:
    """The process. Returns its exit status: 0, 2 for what the user can correct, 70."""
    status = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print

    def say(what: dict) -> None:
        try:
            print(json.dumps(what), file=status, flush=True)
        except BrokenPipeError:
            pass

    try:
        drawing_s = _record(sys.stdin.buffer, say)
    except InputError as error:
        say({"error": str(error)})
        return 2
    except OSError as error:
        say({"error": f"cannot be written: {error.strerror or error}"})
        return 2
    except Exception as error:
        say({"error": f"cannot be recorded: {type(error).__name__}: {error}"})
        return 70
    say({"state": "done", "drawing_s": drawing_s})
    return 0
