# SPDX-License-Identifier: BSD-3-Clause
"""The commands of kys-slam that track no recording. Each returns an exit status."""

import json
import subprocess
import sys
from pathlib import Path
from typing import List

import numpy as np

import kys_slam
from kys_slam import InputError
from kys_slam.cli_output import must_be_new
from kys_slam.cli_parser import make_parser


def evaluate(args) -> int:
    from kys_slam.plot import read_trajectory
    reference = args.reference
    estimate = read_trajectory(Path(args.estimate))
    if reference is None:
        reference = Path(args.estimate) / "ground_truth.tum"
        if not reference.exists():
            raise InputError(f"{args.estimate}: has no ground truth; give --reference FILE")
    truth = kys_slam.read_tum(reference)
    figures = kys_slam.evaluate(*truth, *estimate, alignment=args.align)
    if figures["pairs"] < 2:
        raise InputError(f"{args.estimate}: has no times in common with {reference}: "
                         f"{_span(estimate[0])}, and {_span(truth[0])}")
    if args.json:
        print(json.dumps(figures, indent=2))
        return 0
    ate, rpe = figures["ate_m"], figures["rpe_translation_m"]
    print(f"  poses compared    {figures['pairs']}")
    print(f"  path length       {figures['reference_length_m']:.2f} m")
    note = _other_unit(figures["reference_length_m"], estimate[1])
    if note:
        print(f"  note: {note}")
    print(f"  ATE, rmse         {ate['rmse']:.4f} m (median {ate['median']:.4f}, "
          f"max {ate['max']:.4f})")
    print(f"  RPE, rmse         {rpe['rmse']:.4f} m, {figures['rpe_rotation_deg']['rmse']:.4f} deg")
    if figures["kitti_segments"]:
        print(f"  KITTI             {figures['kitti_translation_percent']:.3f} %, "
              f"{figures['kitti_rotation_deg_per_100m']:.4f} deg per 100 m")
    return 0


def _other_unit(reference_length: float, poses: np.ndarray) -> str:
    """What to suspect where two paths differ by a factor that no estimate is wrong by; else ""."""
    length = float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())
    if length <= 0 or reference_length <= 0 or 0.1 < reference_length / length < 10:
        return ""
    return (f"the reference is {reference_length / length:.3g} times as long as the estimate, "
            f"{length:.2f} m: is it in m?")


def _span(times: np.ndarray) -> str:
    return f"{times[0]:.3f} to {times[-1]:.3f} s" if len(times) else "none"


def plot(args) -> int:
    from kys_slam.plot import draw, load_run
    reference = Path(args.reference) if args.reference else None
    runs = [load_run(Path(run), reference, args.align) for run in args.runs]
    if any(run.figures for run in runs):
        print(f"  {'position error, m':<28} {'rmse':>9} {'mean':>9} {'median':>9} {'max':>9}   poses")
    for run in runs:
        if run.figures:
            values = " ".join(f"{run.figures[key]:9.4f}" for key in ("rmse", "mean", "median", "max"))
            print(f"  {run.name:<28} {values}   {len(run.errors)}")
    output = _output(args, "paths.png")
    draw(runs, output)
    print(f"wrote {output}")
    return 0


def report(args) -> int:
    from kys_slam.report import write_report
    output = _output(args, "report.html")
    write_report([Path(run) for run in args.runs], output)
    print(f"wrote {output}")
    return 0


def _output(args, name: str) -> Path:
    """Where a picture goes: beside the results of the one run that it shows, else where the user is."""
    if args.output:
        return Path(args.output)
    run = Path(args.runs[0])
    return run / name if len(args.runs) == 1 and run.is_dir() else Path(name)


def view(args) -> int:
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
    from kys_slam.record_rerun import has_display
    web = [] if has_display() else ["--serve-web"]
    return subprocess.call([sys.executable, "-m", "rerun", str(path), *web])


def calibrate(args) -> int:
    from kys_slam.cli_calibrate import calibrate_recordings, is_recording
    if args.given or all(is_recording(file) for file in args.files):
        return calibrate_recordings(args)
    rig = kys_slam.read_stereo_rig(args.files, args.calibration_unit)
    rig.check_baseline()
    corrected = any(kys_slam.has_rig_correction(file) for file in args.files)
    if corrected and args.output:
        raise InputError(f"{rig.name}: has a correction, which a copy would lose; it is our YAML already "
                         "(export_rig writes it for other programs)")
    width, height = rig.size
    if args.size:
        width, height = args.size
    if width == 0:
        if args.output:
            raise InputError(f"{rig.name}: does not say the size of the images; give --size WxH")
        print(f"  raw images   of a size that {rig.name} does not say; cameras {rig.baseline:.5f} m apart")
        print("  rectified    depends on the size; give --size WxH")
        return 0
    rig.set_image_size(width, height)
    camera = rig.rectified()
    print(f"  raw images   {width}x{height} px, cameras {rig.baseline:.5f} m apart"
          + (", rectified already" if camera else ""))
    camera = camera or kys_slam.StereoRectifier(rig).camera
    print(f"  rectified    fx {camera.fx:.3f} px, cx {camera.cx:.3f} px, cy {camera.cy:.3f} px, "
          f"baseline {camera.baseline:.5f} m" + (", with a correction" if corrected else ""))
    if args.output:
        must_be_new(args.output, "--output", args)
        Path(args.output).write_text(rig.to_yaml())
        print(f"wrote {args.output}")
    return 0


def priors(args) -> int:
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


def settings(args) -> int:
    settings = kys_slam.Settings.indoor() if args.kind == "indoor" else kys_slam.Settings()
    print(settings.to_yaml(), end="")
    return 0


def completion(args) -> int:
    try:
        import shtab
    except ImportError:
        raise InputError("completion needs shtab: pip install shtab") from None
    print(shtab.complete(make_parser(), args.shell))
    return 0


def demo(args) -> int:
    from kys_slam.demo import run_demo
    return run_demo(args.frames)


#: By name, as the parser has them.
COMMANDS = {"evaluate": evaluate, "plot": plot, "report": report, "view": view, "calibrate": calibrate,
            "priors": priors, "settings": settings, "completion": completion, "demo": demo}
