# SPDX-License-Identifier: BSD-3-Clause
"""The command `kys-slam run`: tracks a recording and saves what came of it."""

import contextlib
import os
import signal
import sys
import time
from pathlib import Path
from typing import Iterator, Optional

import kys_slam
from kys_slam import InputError
from kys_slam._core import _InterruptGuard, _label_space_of_priors
from kys_slam import cli_features, cli_segment
from kys_slam.cli_errors import TRACKING_FAILED, Failures, interrupted, library_warns, warn
from kys_slam.cli_feed import Feed
from kys_slam.cli_input import correction_of, make_settings, open_recording
from kys_slam.cli_output import must_be_new, open_recorders, output_folder
from kys_slam.live import Playback


def run(args) -> int:
    """Returns an exit status."""
    with _signals_interrupt(), library_warns():
        return _run_recording(args)


def _run_recording(args) -> int:
    began = time.monotonic()
    _check_options(args)
    recording = open_recording(args)
    features = cli_features.open_features(args, recording)
    function = cli_segment.open_function(args, recording)
    settings = make_settings(args, recording, _label_space(args, function))
    if isinstance(recording, kys_slam.Sequence):
        recording.check_features(settings)
    mode = settings.get("kys.mode")
    masks = None
    if args.masks:
        from kys_slam.masks import MaskFolder
        masks = MaskFolder(args.masks, settings.get("control.label_space"))
    fixed = None
    if args.mask:
        from kys_slam.masks import FixedMasks
        fixed = FixedMasks(args.mask, (recording.camera.width, recording.camera.height))
    output = output_folder(args, recording.name, mode)
    slam = kys_slam.System(recording.camera, settings, args.schedule, args.priors,
                           strict_priors=args.strict_priors, features=features)
    correction = correction_of(args)
    if correction:
        slam.start_rig(correction)
    if args.load_map:
        slam.load_map(args.load_map, args.localize_only)
    recorders = open_recorders(args, slam)
    frames = recording
    if args.schedule == "realtime":
        frames = Playback(recording, args.late, args.queue, args.speed,
                          float(settings.get("control.stall_ms")))
    segmenter = cli_segment.make_segmenter(args, slam, settings, function) if function else None
    feed = Feed(args, slam, masks, fixed, list(getattr(recording, "notes", ())), len(recording), segmenter)
    start_up_s = time.monotonic() - began
    with _signals_save(slam, frames) as guard:
        failures = Failures()
        wall, cpu = time.monotonic(), time.process_time()
        with failures.guard(), segmenter or contextlib.nullcontext():
            feed.all(frames, lambda: guard.requested)
        feed.progress.end()
        if feed.done == 0 and (failures.status or guard.requested):  # nothing to save
            for recorder in recorders:
                recorder.discard()
            failures.print()
            return failures.status or interrupted()
        with failures.guard():
            slam.finish()
        end_reason = "; ".join(failures.messages)
        if guard.requested and not end_reason:
            end_reason = "interrupted"
        result = None
        with failures.guard():
            result = slam.write_run(output, recording.name, recording.ground_truth,
                                    start_up_s=start_up_s, wall_s=time.monotonic() - wall,
                                    cpu_s=time.process_time() - cpu, end_reason=end_reason,
                                    left_out=_left_out(recording, frames, masks),
                                    warnings=feed.finish(),
                                    recording=getattr(recording, "recording", ""))
        if args.save_map:
            with failures.guard():
                _save_map(args, slam, output)
        _close(recorders, failures)
        if segmenter and not args.quiet:
            print(cli_segment.describe(segmenter, slam.reports()))
        return _tell(args, result, output, failures)


def _label_space(args, function) -> str:
    """That of the segments or the prior files, for control.label_space; "": none is known."""
    if function:
        return function.label_space
    return _label_space_of_priors(args.priors) if args.priors else ""


def _save_map(args, slam: kys_slam.System, output: Path) -> None:
    """A run without keyframes has no map, and leaves one that exists as it is."""
    if not args.load_map and not any(report.keyframe for report in slam.reports()):
        warn(f"{args.save_map}: no map is written, since this run has no keyframes")
        return
    slam._save_map_or_beside(args.save_map, output)


def _close(recorders: list, failures: Failures) -> None:
    for recorder in recorders:
        with failures.guard():
            recorder.close()
            if recorder.skipped:
                print(f"kys-slam: {recorder.skipped} frames were not shown, the viewer was behind",
                      file=sys.stderr)


def _tell(args, result: Optional[dict], output: Path, failures: Failures) -> int:
    """Prints what came of the run. Returns its exit status."""
    if result and not args.quiet:
        print(result["table"], end="")
        print(f"\nresults in {output}")
    failures.print()
    if failures.status:
        return failures.status
    if result["failure"]:
        print(f"kys-slam: {result['failure']}", file=sys.stderr)
        return TRACKING_FAILED
    return 0


def _check_options(args) -> None:
    """Raises InputError for options that contradict each other and for files that cannot be written."""
    cli_segment.check_options(args)
    cli_features.check_options(args)
    if len(args.mask or ()) > 2:
        raise InputError("--mask: one file for the left camera, or two for both")
    if args.localize_only and not args.load_map:
        raise InputError("--localize-only needs --load-map")
    if args.load_map and args.calibration and correction_of(args):
        raise InputError(f"--load-map: the map has its own correction of the calibration, not that of "
                         f"{args.calibration[0]}")
    if args.strict_priors and not args.priors:
        raise InputError("--strict-priors needs --priors")
    if args.schedule != "realtime" and (args.late, args.queue, args.speed) != ("wait", 2, 1):
        raise InputError("--late, --queue and --speed need --schedule realtime: elsewhere frames are "
                         "read as fast as they are tracked")
    for option, target in [("--save-map", args.save_map)] + [("--record", t) for t in args.record]:
        if target and _is_input(target, args):
            raise InputError(f"{option} {target}: is the input")
    targets = [Path(target).resolve() for target in args.record]
    for i, target in enumerate(args.record):
        must_be_new(target, "--record", args)
        if targets[i] in targets[:i]:
            raise InputError(f"{target}: is there twice; one --record per file")
    if args.save_map:
        kys_slam.check_writable(args.save_map)


def _is_input(target: str, args) -> bool:
    """Whether the file is one that is read, also one of a ROS 2 bag's folder."""
    read = list(args.input)
    for folder in args.input:
        if os.path.exists(os.path.join(folder, "metadata.yaml")):
            read += [os.path.join(folder, name) for name in os.listdir(folder)]
    return os.path.exists(target) and any(os.path.exists(file) and os.path.samefile(file, target)
                                          for file in read)


@contextlib.contextmanager
def _signals_interrupt() -> Iterator[None]:
    """SIGTERM and SIGHUP end what comes before tracking as Ctrl-C does, unless the parent process ignores
    them (nohup)."""
    def interrupt(number, frame):
        signal.signal(signal.SIGHUP, signal.SIG_IGN)  # often both come
        raise KeyboardInterrupt

    before = {n: signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGHUP)}
    taken = [n for n, handler in before.items() if handler != signal.SIG_IGN]
    try:
        for number in taken:
            signal.signal(number, interrupt)
        yield
    finally:
        for number in taken:
            signal.signal(number, before[number] or signal.SIG_DFL)


@contextlib.contextmanager
def _signals_save(slam: kys_slam.System, frames) -> Iterator[_InterruptGuard]:
    """The first signal ends tracking and optimisation early, and the run goes on to save what there is; a
    second one ends the program, as with the C++ programs."""
    def interrupt() -> None:  # in a thread of the guard
        slam.interrupt()
        if isinstance(frames, Playback):
            frames.stop()

    python = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    guard = _InterruptGuard(interrupt)
    try:
        yield guard
    finally:
        guard.close()
        for number, handler in python.items():
            if handler is not None:
                signal.signal(number, handler)


def _left_out(recording, frames, masks) -> dict:
    """Counts of what the recording holds and was not used, by what it is."""
    counts = dict(getattr(recording, "counts", {}))
    counts["frames that came too fast"] = frames.dropped if isinstance(frames, Playback) else 0
    counts["frames without a mask"] = masks.missing if masks else 0
    return {what: int(count) for what, count in counts.items() if count}
