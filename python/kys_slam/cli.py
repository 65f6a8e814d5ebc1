"""The command kys-slam: track any stereo recording, evaluate and draw what came of it."""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import List, Optional

import numpy as np

import kys_slam
from kys_slam import InputError
from kys_slam.live import POLICIES, Playback

BAD_INPUT, TRACKING_FAILED, INTERRUPTED = 2, 3, 130
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
    camera.add_argument("--calibration-unit", type=float, default=1, metavar="M",
                        help="metres per unit of the calibration's lengths (mm: 0.001)")
    camera.add_argument("--rate", type=float, metavar="HZ",
                        help="frames per second, where the recording does not say")
    camera.add_argument("--times", default="", metavar="FILE", help="time stamps, s, one per image")
    camera.add_argument("--topics", nargs=2, metavar=("LEFT", "RIGHT"), help="image topics of a bag")
    camera.add_argument("--tolerance", type=float, metavar="S",
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
    slam.add_argument("--queue", type=int, default=2, metavar="N",
                      help="with --late: frames that may wait (default: 2)")
    slam.add_argument("--speed", type=float, default=1, metavar="X",
                      help="with --schedule realtime: play X times as fast as recorded")
    slam.add_argument("--start", type=int, default=0, metavar="N", help="first frame")
    slam.add_argument("--frames", type=int, metavar="N", help="number of frames")
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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("kys-slam", description=_DESCRIPTION,
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
    p.add_argument("--calibration-unit", type=float, default=1, metavar="M")
    p.add_argument("--size", metavar="WxH", help="size of the images, for files without it")
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
    p.add_argument("--frames", type=int, default=40)
    p.set_defaults(command=_demo)
    return parser


# run

def _read_rig(args):
    if not args.calibration:
        raise InputError("which camera is it? --calibration FILE (Kalibr camchain, OpenCV stereo "
                         "calibration, own YAML, or two camera_info files)")
    return kys_slam.read_stereo_rig(args.calibration, args.calibration_unit)


def _open(args):
    """The recording that the command line names."""
    from kys_slam import recordings
    paths = [Path(p) for p in args.input]
    part = {"start": args.start, "frames": args.frames}
    if args.start < 0 or (args.frames is not None and args.frames < 1):
        raise InputError("--start must not be negative, --frames at least 1")
    for path in paths:
        if not path.exists():
            raise InputError(f"{path}: no such file or folder")
    suffixes = {p.suffix.lower() for p in paths}
    if len(paths) > 2:
        raise InputError("give one recording, or LEFT and RIGHT")
    if len(paths) == 2:
        if all(p.is_dir() for p in paths):
            tolerance = {} if args.tolerance is None else {"pairing_tolerance": args.tolerance}
            return kys_slam.open_image_pair(*paths, _read_rig(args), rate=args.rate,
                                            times=args.times, **part, **tolerance)
        if suffixes <= recordings.VIDEO_SUFFIXES:
            return recordings.open_videos(*paths, _read_rig(args), rate=args.rate, **part)
        raise InputError(f"{paths[0]}, {paths[1]}: neither two folders of images nor two videos")
    path = paths[0]
    if suffixes <= recordings.VIDEO_SUFFIXES:
        return recordings.open_videos(path, None, _read_rig(args), rate=args.rate, **part)
    if path.suffix == ".kysp" or (path.is_dir() and any(path.glob("*.kysp"))):
        raise InputError(f"{path}: prior files; give the recording, and these to --priors")
    if path.is_dir() and (path / "summary.json").exists():
        raise InputError(f"{path}: the results of a run; kys-slam evaluate or kys-slam plot")
    is_ros2 = path.is_dir() and (path / "metadata.yaml").exists()
    if suffixes <= recordings.BAG_SUFFIXES and path.is_file() or is_ros2:
        rig = _read_rig(args) if args.calibration else None
        return recordings.open_bag(path, rig, topics=args.topics,
                                   tolerance=args.tolerance or 0.01, **part)
    if path.is_dir():
        inside = _pair_inside(path)
        if inside:
            return kys_slam.open_image_pair(*inside, _read_rig(args), rate=args.rate,
                                            times=args.times, **part)
    tolerance = {} if args.tolerance is None else {"pairing_tolerance": args.tolerance}
    if args.calibration:
        raise InputError(f"{path}: sequences of known layouts bring their calibration; without "
                         "--calibration, or give LEFT and RIGHT")
    return kys_slam.open_sequence(path, pair=args.pair, **part, **tolerance)


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
    if args.config:
        settings.load(args.config)
    for assignment in args.settings:
        key, equals, value = assignment.partition("=")
        if not equals:
            raise InputError(f"'{assignment}' sets nothing: KEY=VALUE expected")
        settings[key] = value
    if args.mode:
        settings["kys.mode"] = args.mode
    has_priors = args.priors or (args.masks and (Path(args.masks) / "classes.txt").exists())
    if has_priors and not args.mode and settings.get("kys.mode") == "stock":
        settings["kys.mode"] = "verified"
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
    targets = args.record + ([VIEWER] if args.view else [])
    return [open_recorder(target, slam) for target in targets]


def _run(args) -> int:
    began = time.monotonic()
    recording = _open(args)
    settings = _make_settings(args, recording.layout)
    if args.localize_only and not args.load_map:
        raise InputError("--localize-only needs --load-map")
    if args.schedule != "realtime" and (args.late, args.speed) != ("wait", 1):
        raise InputError("--late and --speed need --schedule realtime: elsewhere frames are read as "
                         "fast as they are tracked")
    if not 0 < args.speed < 1e6 or args.queue < 1:
        raise InputError("--speed must be above 0, --queue at least 1")
    for target in args.record:
        _must_be_new(target, "--record", args)
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
    progress = _Progress(len(recording), args.quiet)
    watch = _PairWatch()
    end_reason, done, told = "", 0, set()
    start_up_s = time.monotonic() - began
    wall, cpu = time.monotonic(), time.process_time()
    frames = recording
    if args.schedule == "realtime":
        frames = Playback(recording, args.late, args.queue, args.speed)
    try:
        for frame in frames:
            if done == 0 and not args.no_check and frame.left is not None:
                _check_pair(frame)
            watch.check(frame, args.start + done)
            mask = masks(frame.name) if masks else None
            segments = None
            if mask and masks.classes:
                segments, mask = masks.priors(mask), masks.without_classes(mask)
            if isinstance(frame, kys_slam.StereoFrame):
                report = slam.feed_frame(frame, segments, mask)
            else:
                report = slam.feed(frame.left, frame.right, frame.timestamp, segments, mask, name=frame.name)
            if report.warning and report.warning not in told:
                told.add(report.warning)
                print(f"kys-slam: warning: frame {report.index}: {report.warning}", file=sys.stderr,
                      flush=True)
            done += 1
            progress.update(done)
    except KeyboardInterrupt:
        end_reason = "interrupted"
        slam.interrupt()
    except InputError as error:
        if done == 0:
            raise
        end_reason = str(error)
    progress.end()
    slam.finish()
    result = slam.write_run(output, recording.name, recording.ground_truth, start_up_s=start_up_s,
                            wall_s=time.monotonic() - wall, cpu_s=time.process_time() - cpu,
                            end_reason=end_reason, left_out=_left_out(recording, frames, masks),
                            warnings=watch.finish())
    if args.save_map:
        slam.save_map(args.save_map)
    if not args.quiet:
        print(result["table"], end="")
        print(f"\nresults in {output}")
    for recorder in recorders:
        recorder.close()
        if recorder.skipped:
            print(f"kys-slam: {recorder.skipped} frames were not shown, the viewer was behind",
                  file=sys.stderr)
    if end_reason and end_reason != "interrupted":
        print(f"kys-slam: {end_reason}", file=sys.stderr)
        return BAD_INPUT
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
        try:
            width, height = (int(v) for v in args.size.lower().split("x"))
        except ValueError:
            raise InputError(f"'{args.size}' is no size: WxH") from None
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
    """The program. Returns the exit status: 0, 2 for bad usage or input, 3 when tracking failed, 130
    when interrupted before tracking."""
    parser = _parser()
    args = parser.parse_args(argv)
    try:
        return args.command(args)
    except InputError as error:
        print(f"kys-slam: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:  # before anything is tracked; later the run ends in order
        print("kys-slam: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of the output has seen enough, e.g. head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"kys-slam: {where}{error.strerror}", file=sys.stderr)
        return BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
