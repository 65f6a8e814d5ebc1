# SPDX-License-Identifier: BSD-3-Clause
"""Input of `kys-slam run`: the recording and the settings that the command line names."""

from pathlib import Path
from typing import List, Optional

import kys_slam
from kys_slam import InputError

from kys_slam.cli_segment import set_options

_IMAGE_SUFFIXES = {".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".pnm", ".bmp", ".tif", ".tiff"}
INDOOR_LAYOUTS = {"EuRoC", "TUM-VI", "image pair", "video pair", "bag"}


def _read_rig(args):
    if not args.calibration:
        raise InputError("which camera is it? --calibration FILE (Kalibr camchain, OpenCV stereo "
                         "calibration, own YAML, or two camera_info files)")
    return kys_slam.read_stereo_rig(args.calibration, args.calibration_unit or 1)


def correction_of(args) -> Optional[str]:
    """The calibration file that has a correction of the calibration in it."""
    files = args.calibration or []
    return files[0] if len(files) == 1 and kys_slam.has_rig_correction(files[0]) else None


# Options that depend on what the input is: kind of input: those it knows.
_INPUT_OPTIONS = {
    "two folders of images": ("calibration", "calibration_unit", "rate", "times", "tolerance"),
    "a video": ("calibration", "calibration_unit", "rate"),
    "a bag": ("calibration", "calibration_unit", "topics", "tolerance"),
    "a sequence of a known layout": ("calibration", "pair", "tolerance")}


def _check_options(args, path: Path, kind: str) -> None:
    for name in sorted({name for names in _INPUT_OPTIONS.values() for name in names}):
        if name not in _INPUT_OPTIONS[kind] and getattr(args, name) not in (None, ""):
            raise InputError(f"{path}: is {kind}, to which --{name.replace('_', '-')} does not apply")
    if args.calibration_unit and not args.calibration:
        raise InputError("--calibration-unit needs --calibration")


def open_recording(args):
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
    _refuse_loose_images(path)
    _check_options(args, path, "a sequence of a known layout")
    if args.calibration and not correction_of(args):
        raise InputError(f"{path}: contains its calibration: --calibration takes a correction of it "
                         "(kys-slam calibrate); for images of your own give LEFT and RIGHT")
    from kys_slam.cli_segment import pair_of
    sequence = kys_slam.open_sequence(path, pair=pair_of(args, path), **part, **_pairing(args))
    _check_tolerance(args, path, sequence, f"images of {sequence.layout} are paired by number")
    return sequence


def needs_calibration(paths: List[Path]) -> bool:
    """Whether recordings of this kind bring no calibration, or (bags) need not."""
    from kys_slam import recordings
    path = paths[0]
    return (len(paths) == 2 or _pair_inside(path) is not None or (path / "metadata.yaml").exists()
            or path.suffix.lower() in recordings.VIDEO_SUFFIXES | recordings.BAG_SUFFIXES)


def _pairing(args) -> dict:
    return {} if args.tolerance is None else {"pairing_tolerance": args.tolerance}


def _check_tolerance(args, path: Path, sequence, why: str) -> None:
    if args.tolerance is not None and not sequence.paired_by_time:
        raise InputError(f"{path}: {why}, --tolerance does not apply")


def _open_folders(args, paths, part):
    _check_options(args, paths[0], "two folders of images")
    sequence = kys_slam.open_image_pair(*paths, _read_rig(args), rate=args.rate, times=args.times,
                                        **part, **_pairing(args))
    _check_tolerance(args, paths[0], sequence, "images are paired by time only when their names are time "
                     "stamps and neither --rate nor --times is given; otherwise")
    return sequence


def _pair_inside(path: Path):
    """The folders left and right of a folder that has them."""
    for names in (("left", "right"), ("image_left", "image_right")):
        pair = tuple(path / name for name in names)
        if all(p.is_dir() for p in pair):
            return pair
    return None


def _refuse_loose_images(path: Path) -> None:
    """A folder with images is no sequence: how to make a pair of it."""
    if not path.is_dir():
        return
    names = [p.name.lower() for p in path.iterdir() if p.suffix.lower() in _IMAGE_SUFFIXES]
    if not names:
        return
    if all("left" in name or "right" in name for name in names):
        raise InputError(f"{path}: images of both cameras in one folder; move those of the left one to a "
                         "folder left, those of the right one to a folder right")
    raise InputError(f"{path}: one folder of images; give two, LEFT and RIGHT (both images of a pair in one "
                     "file: make a video of the files, which is divided in the middle)")


def make_settings(args, recording, label_space: str = "") -> kys_slam.Settings:
    """The settings, checked. The recording selects the defaults: by its layout, and by the priors that
    a feature file may have. `label_space`: of the priors, where nothing else is said."""
    indoor = args.kind == "indoor" or (args.kind is None and recording.layout in INDOOR_LAYOUTS)
    settings = kys_slam.Settings.indoor() if indoor else kys_slam.Settings()
    if label_space:
        settings["control.label_space"] = label_space
    has_priors = (args.priors or getattr(args, "segment", None) or getattr(recording, "label_space", "")
                  or (args.masks and (Path(args.masks) / "classes.txt").exists()))
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
    if getattr(args, "segment", None):
        set_options(args, settings)
    settings.check()
    mode = settings.get("kys.mode")
    if not has_priors and kys_slam.mode_needs_priors(mode):
        raise InputError(f"mode {mode} needs priors: give --priors DIR, or --mode stock")
    return settings
