# SPDX-License-Identifier: BSD-3-Clause
"""The command `kys-slam calibrate` for recordings: runs each, and estimates the correction of the rig's
calibration from their maps."""

import sys
import tempfile
from pathlib import Path
from typing import List, Optional

import kys_slam
from kys_slam import InputError
from kys_slam.cli_output import must_be_new
from kys_slam.programs import find_program, run_program

PROGRAM = "calibrate_rig"


def is_recording(text: str) -> bool:
    """Whether it names a recording, not a calibration file: a folder, a video, a bag, a feature file, or
    LEFT,RIGHT."""
    from kys_slam.recordings import BAG_SUFFIXES, VIDEO_SUFFIXES
    suffixes = VIDEO_SUFFIXES | BAG_SUFFIXES | {".features"}
    return all(Path(part).is_dir() or Path(part).suffix.lower() in suffixes for part in _parts(text))


def _parts(text: str) -> List[str]:
    return [text] if Path(text).exists() else text.split(",")


def calibrate_recordings(args) -> int:
    """Returns an exit status."""
    from kys_slam.cli_run import run
    if not args.output:
        raise InputError("--output FILE is missing: where the refined calibration goes")
    must_be_new(args.output, "--output", args)
    kys_slam.check_writable(args.output)
    program = find_program(PROGRAM)
    with tempfile.TemporaryDirectory(prefix="kys-calibrate-") as folder:
        maps = []
        rig = None
        for k, recording in enumerate(args.files):
            run_args = _run_args(args, _parts(recording), Path(folder), k)
            if k == 0:
                rig = _given_rig(args, run_args, Path(folder) / "given.yaml")
            print(f"kys-slam: {recording} ({k + 1} of {len(args.files)})", file=sys.stderr)
            status = run(run_args)
            if status:
                return status
            if not Path(run_args.save_map).exists():
                raise InputError(f"{recording}: has no keyframes, there is nothing to calibrate with")
            maps.append(run_args.save_map)
        call = [program, *maps, "-o", args.output, "--hold-out", str(args.hold_out)]
        if rig:
            call += ["--from", str(rig)]
        if args.json:
            call += ["--json", args.json]
        status = run_program(call)
    if status == 0:
        print(f"wrote {args.output}")
    return status


def _run_args(args, inputs: List[str], folder: Path, number: int):
    """What `kys-slam run` would be called with."""
    from kys_slam.cli_parser import make_parser
    call = ["run", *inputs, "--quiet", "--schedule", args.schedule,
            "--output", str(folder / f"run{number}"),
            "--save-map", str(folder / f"{number + 1}-{Path(inputs[0]).resolve().stem}.map")]
    if args.given and not _brings_calibration(inputs):
        call += ["--calibration", *args.given]
        if args.calibration_unit != 1:
            call += ["--calibration-unit", str(args.calibration_unit)]
    for name in ("rate", "tolerance", "frames", "pair", "kind"):
        value = getattr(args, name)
        if value not in (None, ""):
            call += [f"--{name}", str(value)]
    if args.topics:
        call += ["--topics", *args.topics]
    for assignment in args.settings:
        call += ["--set", assignment]
    return make_parser().parse_args(call)


def _brings_calibration(inputs: List[str]) -> bool:
    """Sequences of a known layout bring their own."""
    from kys_slam.cli_input import needs_calibration
    return not needs_calibration([Path(p) for p in inputs])


def _given_rig(args, run_args, file: Path) -> Optional[Path]:
    """The given calibration of raw images, whatever its format, as one file with their size; None for
    sequences that bring their own."""
    from kys_slam.cli_input import open_recording
    if not args.given:
        rig = getattr(open_recording(run_args), "rig", None)  # a bag's camera_info
        if rig is None:
            return None
    else:
        rig = kys_slam.read_stereo_rig(args.given, args.calibration_unit)
        if rig.size[0] == 0:
            camera = open_recording(run_args).camera
            rig.set_image_size(camera.width, camera.height)
    file.write_text(rig.to_yaml())
    return file
