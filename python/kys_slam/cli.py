"""The command kys-slam: track any stereo recording, evaluate and draw what came of it."""

import argparse
import contextlib
import io
import json
import math
import os
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path
from typing import Iterator, List, Optional, Tuple

import numpy as np

import kys_slam
from kys_slam import InputError
from kys_slam.live import POLICIES, Playback

BAD_INPUT, TRACKING_FAILED, DEFECT, INTERRUPTED = 2, 3, 70, 130
INDOOR_LAYOUTS = {"EuRoC", "TUM-VI", "image pair", "video pair", "bag"}
RUN_FILES = ("summary.json", "trajectory.tum", "frames.csv")

_DESCRIPTION = """Stereo visual SLAM on any stereo recording.

  kys-slam run SEQUENCE                                  KITTI, Virtual KITTI 2, EuRoC, TUM-VI
  kys-slam run left.mp4 right.mp4 --calibration camchain.yaml
  kys-slam run left/ right/ --calibration camchain.yaml --rate 20
  kys-slam run recording.bag                             ROS 1, ROS 2, MCAP
  kys-slam run recording.bag --view                      what it sees, while it runs
  kys-slam evaluate RUN
  kys-slam plot RUN [RUN ...]
  kys-slam report RUN [RUN ...]                          one page to read or send
"""


# Values of options: what is outside their range is refused with the option's name.

def _whole(low: int):
    def whole_number(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) < 2**31:
            raise argparse.ArgumentTypeError(f"'{text}' is no whole number from {low} to {2**31 - 1}")
        return int(text)
    return whole_number


def _number(low: float, high: float, exclusive: bool = True):
    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (low < value if exclusive else low <= value) or value > high:
            raise argparse.ArgumentTypeError(
                f"'{text}' is no number {'above' if exclusive else 'from'} {low:g} to {high:g}")
        return value
    return number


def _size(text: str) -> Tuple[int, int]:
    sides = text.lower().split("x")
    if len(sides) != 2 or not all(s.isdecimal() and 0 < int(s) <= 16384 for s in sides):
        raise argparse.ArgumentTypeError(f"'{text}' is no size: WxH, each 1 to 16384 px")
    return int(sides[0]), int(sides[1])


def _add_run(commands) -> None:
    p = commands.add_parser(
        "run", help="track a recording",
        description="Tracks a recording: a sequence folder (KITTI odometry or Tracking, Virtual "
        "KITTI 2, EuRoC, TUM-VI), two folders of images, two videos, one video of both images side "
        "by side, a ROS bag, or a feature file. What it is, is seen from what it holds.")
    p.add_argument("input", nargs="+", metavar="INPUT", help="one path, or LEFT and RIGHT")
    camera = p.add_argument_group("camera")
    camera.add_argument("--calibration", nargs="+", metavar="FILE",
                        help="Kalibr camchain, OpenCV stereo calibration, our YAML, or the "
                        "camera_info files of the left and the right camera")
    camera.add_argument("--calibration-unit", type=_number(0, 1e6), metavar="M",
                        help="metres per unit of the calibration's lengths (mm: 0.001)")
    camera.add_argument("--rate", type=_number(0, 1e5), metavar="HZ",
                        help="frames per second, where the recording does not say")
    camera.add_argument("--times", default="", metavar="FILE", help="time stamps, s, one per image")
    camera.add_argument("--topics", nargs=2, metavar=("LEFT", "RIGHT"), help="image topics of a bag")
    camera.add_argument("--tolerance", type=_number(0, 3600, exclusive=False), metavar="S",
                        help="largest time difference of a pair (default: 0.003 for folders, 0.01 "
                        "for bags)")
    camera.add_argument("--pair", default="", choices=("grey", "colour"),
                        help="of a KITTI odometry sequence: image_0 and image_1 (default if they "
                        "exist), or image_2 and image_3")
    camera.add_argument("--no-check", action="store_true",
                        help="do not check whether the pair is swapped or not rectified")
    slam = p.add_argument_group("tracking")
    slam.add_argument("--priors", metavar="DIR", help="prior files of this recording")
    slam.add_argument("--strict-priors", action="store_true", help="a missing prior file is an error")
    slam.add_argument("--masks", metavar="DIR",
                      help="8-bit PNG files, 0 = use: DIR/left/NAME.png and DIR/right/NAME.png; with "
                      "DIR/classes.txt they are priors (python/README.md)")
    slam.add_argument("--mode", help="matching mode:  " + ", ".join(kys_slam.modes()) +
                      " (default: verified with --priors, stock without)")
    slam.add_argument("--kind", choices=("driving", "indoor"),
                      help="defaults of the settings (default: by the recording)")
    slam.add_argument("--config", metavar="FILE", help="YAML file of settings")
    slam.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings",
                      help="one setting, may be repeated; kys-slam settings lists them")
    slam.add_argument("--schedule", default="pipelined",
                      choices=("pipelined", "sequential", "realtime"))
    slam.add_argument("--late", default="wait", choices=POLICIES, metavar="POLICY",
                      help="with --schedule realtime: policy for frames that arrive faster than "
                      "they are tracked: wait (default), drop-oldest, drop-newest")
    slam.add_argument("--queue", type=_whole(1), default=2, metavar="N",
                      help="with --late: frames that may wait (default: 2)")
    slam.add_argument("--speed", type=_number(0, 1e6), default=1, metavar="X",
                      help="with --schedule realtime: play X times as fast as recorded")
    slam.add_argument("--start", type=_whole(0), default=0, metavar="N", help="first frame")
    slam.add_argument("--frames", type=_whole(1), metavar="N", help="number of frames")
    slam.add_argument("--load-map", metavar="FILE", help="continue with this map")
    slam.add_argument("--save-map", metavar="FILE", help="write the map at the end")
    slam.add_argument("--localize-only", action="store_true", help="do not change the map")
    out = p.add_argument_group("output")
    out.add_argument("--output", metavar="DIR", help="default: runs/NAME-MODE")
    out.add_argument("--overwrite", action="store_true", help="allow an output folder with another run")
    out.add_argument("--view", action="store_true",
                     help="show the observations while it runs (needs rerun-sdk)")
    out.add_argument("--record", action="append", default=[], metavar="FILE",
                     help="record the observations to FILE.rrd (Rerun) or FILE.mcap (Foxglove); may "
                     "be repeated")
    out.add_argument("--quiet", action="store_true", help="no progress, no table")
    p.set_defaults(command=_run)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str):
        self.exit(BAD_INPUT, f"{self.prog}: {' '.join(message.split())}; see --help\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser("kys-slam", description=_DESCRIPTION,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", action="version", version=f"KYS-SLAM {kys_slam.__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    _add_run(commands)

    p = commands.add_parser("evaluate", help="errors of a run, or of a trajectory, in figures")
    p.add_argument("estimate", metavar="RUN|FILE", help="folder of a run, or a TUM file")
    p.add_argument("--reference", metavar="FILE",
                   help="TUM file of the same camera (default: the run's ground_truth.tum)")
    p.add_argument("--align", default="se3", choices=("se3", "sim3", "none"))
    p.add_argument("--json", action="store_true")
    p.set_defaults(command=_evaluate)

    p = commands.add_parser("plot", help="paths and errors of one or several runs over ground truth")
    p.add_argument("runs", nargs="+", metavar="RUN", help="folders of runs, or TUM files")
    p.add_argument("--reference", metavar="FILE",
                   help="TUM file of the same camera (default: each run's ground_truth.tum)")
    p.add_argument("--align", default="se3", choices=("se3", "sim3", "none"))
    p.add_argument("--output", default="paths.png", metavar="FILE", help="default: paths.png")
    p.set_defaults(command=_plot)

    p = commands.add_parser("report", help="one HTML page of one or several runs")
    p.add_argument("runs", nargs="+", metavar="RUN", help="folders of runs")
    p.add_argument("--output", default="report.html", metavar="FILE", help="default: report.html")
    p.set_defaults(command=_report)

    p = commands.add_parser("view", help="shows a recording (--record) in Rerun's viewer")
    p.add_argument("file", metavar="FILE|RUN", help=".rrd, .mcap, map.ply, or a run's folder")
    p.set_defaults(command=_view)

    p = commands.add_parser("calibrate", help="show a calibration after rectification; convert it")
    p.add_argument("files", nargs="+", metavar="FILE")
    p.add_argument("--calibration-unit", type=_number(0, 1e6), default=1, metavar="M")
    p.add_argument("--size", type=_size, metavar="WxH", help="size of the images, for files without it")
    p.add_argument("--output", metavar="FILE", help="write it as our YAML, lengths in m")
    p.add_argument("--overwrite", action="store_true", help="replace an existing FILE")
    p.set_defaults(command=_calibrate)

    p = commands.add_parser("priors", help="content of prior files")
    p.add_argument("files", nargs="+", metavar="FILE|DIR")
    p.set_defaults(command=_priors)

    p = commands.add_parser("settings", help="every setting with its default")
    p.add_argument("--kind", choices=("driving", "indoor"), default="driving")
    p.set_defaults(command=_settings)

    p = commands.add_parser("completion", help="a script that completes commands in a shell",
                            description="bash: kys-slam completion bash > "
                            "~/.local/share/bash-completion/completions/kys-slam")
    p.add_argument("shell", choices=("bash", "zsh", "tcsh"))
    p.set_defaults(command=_completion)

    p = commands.add_parser("demo", help="test the installation on a small simulated corridor")
    p.add_argument("--frames", type=_whole(1), default=40)
    p.set_defaults(command=_demo)
    return parser


# run

def _read_rig(args):
    if not args.calibration:
        raise InputError("which camera is it? --calibration FILE (Kalibr camchain, OpenCV stereo "
                         "calibration, own YAML, or two camera_info files)")
    return kys_slam.read_stereo_rig(args.calibration, args.calibration_unit or 1)


# Options that depend on what the input is: kind of input: those it knows.
_INPUT_OPTIONS = {
    "two folders of images": ("calibration", "calibration_unit", "rate", "times", "tolerance"),
    "a video": ("calibration", "calibration_unit", "rate"),
    "a bag": ("calibration", "calibration_unit", "topics", "tolerance"),
    "a sequence of a known layout": ("pair", "tolerance")}


def _check_options(args, path: Path, kind: str) -> None:
    for name in sorted({name for names in _INPUT_OPTIONS.values() for name in names}):
        if name not in _INPUT_OPTIONS[kind] and getattr(args, name) not in (None, ""):
            more = (": it contains its calibration; for images of your own give LEFT and RIGHT"
                    if name == "calibration" else "")
            raise InputError(f"{path}: is {kind}, to which --{name.replace('_', '-')} does not "
                             f"apply{more}")
    if args.calibration_unit and not args.calibration:
        raise InputError("--calibration-unit needs --calibration")


def _open(args):
    """The recording that the command line names."""
    from kys_slam import recordings
    paths = [Path(p) for p in args.input]
    part = {"start": args.start, "frames": args.frames}
    for path in paths:
        if not path.exists():
            raise InputError(f"{path}: no such file or folder")
    suffixes = {p.suffix.lower() for p in paths}
    if len(paths) > 2:
        raise InputError("give one recording, or LEFT and RIGHT")
    path = paths[0]
    if suffixes <= recordings.VIDEO_SUFFIXES and not any(p.is_dir() for p in paths):
        _check_options(args, path, "a video")
        right = paths[1] if len(paths) == 2 else None
        return recordings.open_videos(path, right, _read_rig(args), rate=args.rate, **part)
    if len(paths) == 2:
        if all(p.is_dir() for p in paths):
            return _open_folders(args, paths, part)
        raise InputError(f"{paths[0]}, {paths[1]}: neither two folders of images nor two videos")
    if path.suffix == ".kysp" or (path.is_dir() and any(path.glob("*.kysp"))):
        raise InputError(f"{path}: prior files; give the recording, and these to --priors")
    if path.is_dir() and (path / "summary.json").exists():
        raise InputError(f"{path}: the results of a run; kys-slam evaluate or kys-slam plot")
    is_ros2 = path.is_dir() and (path / "metadata.yaml").exists()
    if suffixes <= recordings.BAG_SUFFIXES and path.is_file() or is_ros2:
        _check_options(args, path, "a bag")
        rig = _read_rig(args) if args.calibration else None
        tolerance = {} if args.tolerance is None else {"tolerance": args.tolerance}
        return recordings.open_bag(path, rig, topics=args.topics, **part, **tolerance)
    inside = _pair_inside(path)
    if inside:
        return _open_folders(args, inside, part)
    _check_options(args, path, "a sequence of a known layout")
    sequence = kys_slam.open_sequence(path, pair=args.pair, **part, **_pairing(args))
    if args.tolerance is not None and sequence.layout not in INDOOR_LAYOUTS:
        raise InputError(f"{path}: images of {sequence.layout} are paired by number, --tolerance does "
                         "not apply")
    return sequence


def _pairing(args) -> dict:
    return {} if args.tolerance is None else {"pairing_tolerance": args.tolerance}


def _open_folders(args, paths, part):
    _check_options(args, paths[0], "two folders of images")
    return kys_slam.open_image_pair(*paths, _read_rig(args), rate=args.rate, times=args.times, **part,
                                    **_pairing(args))


def _pair_inside(path: Path):
    """The folders left and right of a folder that has them."""
    for names in (("left", "right"), ("image_left", "image_right")):
        pair = tuple(path / name for name in names)
        if all(p.is_dir() for p in pair):
            return pair
    return None


def _make_settings(args, layout: str) -> kys_slam.Settings:
    indoor = args.kind == "indoor" or (args.kind is None and layout in INDOOR_LAYOUTS)
    settings = kys_slam.Settings.indoor() if indoor else kys_slam.Settings()
    has_priors = args.priors or (args.masks and (Path(args.masks) / "classes.txt").exists())
    if has_priors:  # a mode that is named anywhere takes the place of this one
        settings["kys.mode"] = "verified"
    if args.config:
        settings.load(args.config)
    for assignment in args.settings:
        key, equals, value = assignment.partition("=")
        if not equals:
            raise InputError(f"'{assignment}' sets nothing: KEY=VALUE expected")
        settings[key] = value
    if args.mode:
        settings["kys.mode"] = args.mode
    settings.check()
    mode = settings.get("kys.mode")
    if not has_priors and kys_slam.mode_needs_priors(mode):
        raise InputError(f"mode {mode} needs priors: give --priors DIR, or --mode stock")
    return settings


def _output_folder(args, name: str, mode: str) -> Path:
    if args.output:
        folder = Path(args.output)
        if not args.overwrite and any((folder / f).exists() for f in RUN_FILES):
            raise InputError(f"{folder}: holds another run; --overwrite, or another --output")
    else:
        folder = Path("runs") / f"{name}-{mode}"
        number = 2
        while not args.overwrite and folder.exists() and any(folder.iterdir()):
            folder = Path("runs") / f"{name}-{mode}-{number}"
            number += 1
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write {folder}: {error.strerror}") from None
    if not os.access(folder, os.W_OK):
        raise InputError(f"cannot write {folder}")
    return folder


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

    def check(self, frame, index: int) -> None:
        before = self.history.warning
        if self.history.count_frame() and frame.left is not None:
            self.history.check(frame.left, frame.right, index)
        self._tell(before)

    def finish(self) -> list:
        """All messages."""
        before = self.history.warning
        self.history.finish()
        self._tell(before)
        return [self.history.warning] if self.history.warning else []

    def _tell(self, before: str) -> None:
        if self.history.warning != before:
            print(f"kys-slam: warning: {self.history.warning}", file=sys.stderr, flush=True)


def _check_pair(frame) -> None:
    check = kys_slam.check_stereo_pair(frame.left, frame.right)
    if check.problem:
        raise InputError(f"frame {frame.name}: {check.problem} (--no-check to go on)")


def _must_be_new(file: str, option: str, args) -> None:
    if Path(file).exists() and not args.overwrite:
        raise InputError(f"{file}: is there already; --overwrite, or another {option}")


def _open_recorders(args, slam) -> list:
    if not args.view and not args.record:
        return []
    from kys_slam.record import VIEWER, open_recorder
    recorders: list = []
    try:
        for target in args.record + ([VIEWER] if args.view else []):
            recorders.append(open_recorder(target, slam))
    except BaseException:
        for recorder in recorders:
            recorder.discard()
        raise
    return recorders


def _check_output_options(args) -> None:
    """What can be said before anything is tracked."""
    if args.localize_only and not args.load_map:
        raise InputError("--localize-only needs --load-map")
    if args.schedule != "realtime" and (args.late, args.queue, args.speed) != ("wait", 2, 1):
        raise InputError("--late, --queue and --speed need --schedule realtime: elsewhere frames are "
                         "read as fast as they are tracked")
    targets = [Path(target).resolve() for target in args.record]
    for i, target in enumerate(args.record):
        _must_be_new(target, "--record", args)
        if targets[i] in targets[:i]:
            raise InputError(f"{target}: is there twice; one --record per file")
    if args.save_map:
        kys_slam.check_writable(args.save_map)


def _describe(error: BaseException) -> Tuple[int, str]:
    """Exit status and message of what went wrong, as the C++ programs have them."""
    if isinstance(error, OSError):
        where = f"{os.fsdecode(error.filename)}: " if error.filename else ""
        return BAD_INPUT, f"{where}{error.strerror or error}"
    if isinstance(error, MemoryError):
        return BAD_INPUT, "out of memory"
    text = " ".join(str(error).split())
    if isinstance(error, InputError):
        return BAD_INPUT, text
    at = traceback.extract_tb(error.__traceback__)[-1]
    return DEFECT, (f"a defect of the program: {type(error).__name__}: {text} "
                    f"({Path(at.filename).name}:{at.lineno})")


class _Failures:
    """What goes wrong during a run; the run goes on to save what there is."""

    def __init__(self) -> None:
        self.status = 0
        self.messages: List[str] = []

    @contextlib.contextmanager
    def guard(self) -> Iterator[None]:
        """Notes what one step raises."""
        try:
            yield
        except Exception as error:
            status, message = _describe(error)
            self.status = self.status or status
            if message not in self.messages:
                self.messages.append(message)

    def print(self) -> None:
        for message in self.messages:
            print(f"kys-slam: {message}", file=sys.stderr)


@contextlib.contextmanager
def _signals_interrupt() -> Iterator[None]:
    """SIGTERM and SIGHUP end a run as Ctrl-C does, unless the parent process ignores them (nohup)."""
    def interrupt(number, frame):
        signal.signal(signal.SIGHUP, signal.SIG_IGN)  # often both come; the results are being saved
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


class _Feed:
    """Feeds the frames of a recording to a system."""

    def __init__(self, args, slam, masks, total: int) -> None:
        self.args, self.slam, self.masks = args, slam, masks
        self.progress, self.watch = _Progress(total, args.quiet), _PairWatch()
        self.done, self._told = 0, set()

    def all(self, frames) -> None:
        for frame in frames:
            if self.done == 0 and not self.args.no_check and frame.left is not None:
                _check_pair(frame)
            self._feed(frame)
            self.done += 1
            self.progress.update(self.done)

    def _feed(self, frame) -> None:
        self.watch.check(frame, self.args.start + self.done)
        mask = self.masks(frame.name) if self.masks else None
        segments = None
        if mask and self.masks.classes:
            segments, mask = self.masks.priors(mask), self.masks.without_classes(mask)
        if isinstance(frame, kys_slam.StereoFrame):
            report = self.slam.feed_frame(frame, segments, mask)
        else:
            report = self.slam.feed(frame.left, frame.right, frame.timestamp, segments, mask,
                                    name=frame.name)
        if report.warning and report.warning not in self._told:
            self._told.add(report.warning)
            print(f"kys-slam: warning: frame {report.index}: {report.warning}", file=sys.stderr,
                  flush=True)


def _run(args) -> int:
    with _signals_interrupt():
        return _run_recording(args)


def _run_recording(args) -> int:
    began = time.monotonic()
    _check_output_options(args)
    recording = _open(args)
    settings = _make_settings(args, recording.layout)
    if isinstance(recording, kys_slam.Sequence):
        recording.check_features(settings)
    mode = settings.get("kys.mode")
    masks = None
    if args.masks:
        from kys_slam.masks import MaskFolder
        masks = MaskFolder(args.masks, settings.get("control.label_space"))
    output = _output_folder(args, recording.name, mode)
    slam = kys_slam.System(recording.camera, settings, args.schedule, args.priors,
                           strict_priors=args.strict_priors)
    if args.load_map:
        slam.load_map(args.load_map, args.localize_only)
    recorders = _open_recorders(args, slam)
    feed = _Feed(args, slam, masks, len(recording))
    failures, interrupted = _Failures(), False
    start_up_s = time.monotonic() - began
    wall, cpu = time.monotonic(), time.process_time()
    frames = recording
    if args.schedule == "realtime":
        frames = Playback(recording, args.late, args.queue, args.speed)
    try:
        with failures.guard():
            feed.all(frames)
    except KeyboardInterrupt:
        interrupted = True
        slam.interrupt()
    feed.progress.end()
    if failures.status and feed.done == 0:  # nothing to save
        for recorder in recorders:
            recorder.discard()
        failures.print()
        return failures.status
    with failures.guard():
        slam.finish()
    end_reason = "interrupted" if interrupted else "; ".join(failures.messages)
    result = None
    with failures.guard():
        result = slam.write_run(output, recording.name, recording.ground_truth, start_up_s=start_up_s,
                                wall_s=time.monotonic() - wall, cpu_s=time.process_time() - cpu,
                                end_reason=end_reason, left_out=_left_out(recording, frames, masks),
                                warnings=feed.watch.finish())
    if args.save_map:
        with failures.guard():
            slam._save_map_or_beside(args.save_map, output)
    for recorder in recorders:
        with failures.guard():
            recorder.close()
            if recorder.skipped:
                print(f"kys-slam: {recorder.skipped} frames were not shown, the viewer was behind",
                      file=sys.stderr)
    if result and not args.quiet:
        print(result["table"], end="")
        print(f"\nresults in {output}")
    failures.print()
    if failures.status:
        return failures.status
    if 2 * result["tracked"] < result["frames"] or not result["frames"]:
        print(f"kys-slam: tracking failed: {result['tracked']} of {result['frames']} frames tracked",
              file=sys.stderr)
        return TRACKING_FAILED
    return 0


def _left_out(recording, frames, masks) -> dict:
    """Counts of what the recording holds and was not used, by what it is."""
    counts = dict(getattr(recording, "counts", {}))
    counts["images without a partner"] = getattr(recording, "dropped", 0)
    counts["frames that came too fast"] = frames.dropped if isinstance(frames, Playback) else 0
    counts["frames without a mask"] = masks.missing if masks else 0
    return {what: int(count) for what, count in counts.items() if count}


# evaluate, plot, calibrate, priors, settings

def _evaluate(args) -> int:
    from kys_slam.plot import read_trajectory
    reference = args.reference
    estimate = read_trajectory(Path(args.estimate))
    if reference is None:
        reference = Path(args.estimate) / "ground_truth.tum"
        if not reference.exists():
            raise InputError(f"{args.estimate}: has no ground truth; give --reference FILE")
    figures = kys_slam.evaluate(*kys_slam.read_tum(reference), *estimate,
                                alignment=args.align)
    if figures["pairs"] < 2:
        raise InputError("the two trajectories have no times in common")
    if args.json:
        print(json.dumps(figures, indent=2))
        return 0
    ate, rpe = figures["ate_m"], figures["rpe_translation_m"]
    print(f"  poses compared    {figures['pairs']}")
    print(f"  path length       {figures['reference_length_m']:.2f} m")
    print(f"  ATE, rmse         {ate['rmse']:.4f} m (median {ate['median']:.4f}, "
          f"max {ate['max']:.4f})")
    print(f"  RPE, rmse         {rpe['rmse']:.4f} m, {figures['rpe_rotation_deg']['rmse']:.4f} deg")
    if figures["kitti_segments"]:
        print(f"  KITTI             {figures['kitti_translation_percent']:.3f} %, "
              f"{figures['kitti_rotation_deg_per_100m']:.4f} deg per 100 m")
    return 0


def _plot(args) -> int:
    from kys_slam.plot import draw, load_run
    reference = Path(args.reference) if args.reference else None
    runs = [load_run(Path(run), reference, args.align) for run in args.runs]
    if any(run.figures for run in runs):
        print(f"  {'position error, m':<28} {'rmse':>9} {'mean':>9} {'median':>9} {'max':>9}   poses")
    for run in runs:
        if run.figures:
            values = " ".join(f"{run.figures[key]:9.4f}" for key in ("rmse", "mean", "median", "max"))
            print(f"  {run.name:<28} {values}   {len(run.errors)}")
    draw(runs, Path(args.output))
    print(f"wrote {args.output}")
    return 0


def _report(args) -> int:
    from kys_slam.report import write_report
    write_report([Path(run) for run in args.runs], Path(args.output))
    print(f"wrote {args.output}")
    return 0


def _view(args) -> int:
    path = Path(args.file)
    if path.is_dir():
        found = sorted(path.glob("*.rrd")) or sorted(path.glob("*.mcap")) or sorted(
            path.glob("map.ply"))
        if not found:
            raise InputError(f"{path}: holds nothing to view; kys-slam run ... --record FILE.rrd")
        path = found[0]
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.suffix == ".bag" or path.suffix not in (".rrd", ".mcap", ".ply"):
        raise InputError(f"{path}: not a recording of this program; kys-slam run {path} --view")
    try:
        import rerun  # noqa: F401
    except ImportError:
        raise InputError("viewing needs Rerun: pip install rerun-sdk" + (
            "; Foxglove opens .mcap files too" if path.suffix == ".mcap" else "")) from None
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    web = [] if display or sys.platform != "linux" else ["--serve-web"]
    return subprocess.call([sys.executable, "-m", "rerun", str(path), *web])


def _completion(args) -> int:
    try:
        import shtab
    except ImportError:
        raise InputError("completion needs shtab: pip install shtab") from None
    print(shtab.complete(_parser(), args.shell))
    return 0


def _calibrate(args) -> int:
    rig = kys_slam.read_stereo_rig(args.files, args.calibration_unit)
    width, height = rig.size
    if args.size:
        width, height = args.size
    if width == 0:
        raise InputError(f"{rig.name}: does not say the size of the images; give --size WxH")
    rig.set_image_size(width, height)
    camera = rig.rectified()
    print(f"  raw images   {width}x{height} px, cameras {rig.baseline:.5f} m apart"
          + (", rectified already" if camera else ""))
    camera = camera or kys_slam.StereoRectifier(rig).camera
    print(f"  rectified    fx {camera.fx:.3f} px, cx {camera.cx:.3f} px, cy {camera.cy:.3f} px, "
          f"baseline {camera.baseline:.5f} m")
    if args.output:
        _must_be_new(args.output, "--output", args)
        Path(args.output).write_text(rig.to_yaml())
        print(f"wrote {args.output}")
    return 0


def _priors(args) -> int:
    from kys_slam.kysp import DYNAMIC
    files: List[Path] = []
    for name in args.files:
        path = Path(name)
        found = sorted(path.glob("*.kysp")) if path.is_dir() else [path]
        if not found:
            raise InputError(f"{path}: has no prior files (*.kysp)")
        files += found
    for path in files:
        frame = kys_slam.read_prior(path)
        cameras = []
        for camera in frame.cameras:
            moving = int(np.count_nonzero(camera.segments["flags"] & DYNAMIC))
            covered = 100 * np.count_nonzero(camera.segment_map) / camera.segment_map.size
            cameras.append(f"{len(camera.segments)} segments ({moving} moving), "
                           f"{covered:.1f} % covered")
        height, width = frame.cameras[0].segment_map.shape
        print(f"{path}: {width}x{height}, {frame.label_space}; " + "; ".join(cameras))
    return 0


def _settings(args) -> int:
    settings = kys_slam.Settings.indoor() if args.kind == "indoor" else kys_slam.Settings()
    print(settings.to_yaml(), end="")
    return 0


def _demo(args) -> int:
    from kys_slam.demo import run_demo
    return run_demo(args.frames)


def main(argv: Optional[List[str]] = None) -> int:
    """The program. Returns the exit status: 0, 2 for bad usage or input, 3 when tracking failed, 70
    for a defect of the program, 130 when interrupted before tracking."""
    for stream in (sys.stdout, sys.stderr):  # names of files may be no text
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    args = _parser().parse_args(argv)
    try:
        return args.command(args)
    except KeyboardInterrupt:  # before anything is tracked; later the run ends in order
        print("kys-slam: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of the output has seen enough, e.g. head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        status, message = _describe(error)
        print(f"kys-slam: {message}", file=sys.stderr)
        return status


if __name__ == "__main__":
    sys.exit(main())
