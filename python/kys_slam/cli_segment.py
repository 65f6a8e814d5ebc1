# SPDX-License-Identifier: BSD-3-Clause
"""The options --segment... of `kys-slam run`: a network beside the tracker, or its stored results."""

from pathlib import Path
from typing import Any, Optional

import numpy as np

import kys_slam
from kys_slam import InputError, PriorCamera, PriorFrame
from kys_slam.colour import left_colour
from kys_slam.kysp import SEGMENT, THING
from kys_slam.segment_network import NetworkError, SegmentNetwork, need
from kys_slam._core import _label_space_of_priors
from kys_slam.priors import read_prior
from kys_slam.segmenter import Function, Segmenter, from_folder

_FIRST_THING = 65536  # instances of things in prior files


def to_priors(space: "kys_slam.LabelSpace", ids: np.ndarray, segments: list,
              calibration_hash: int = 0) -> PriorFrame:
    """Segments of one image, as SegmentNetwork gives them, as priors of its left camera."""
    index_of = {class_id: index for index, class_id in enumerate(space.ids)}
    number = np.zeros(max((s["id"] for s in segments), default=0) + 1, np.uint16)
    rows = []
    for segment in segments:
        label = index_of[segment["category_id"]]
        thing = bool(segment["isthing"])
        rows.append((label, THING if thing else 0, _FIRST_THING + len(rows) if thing else label, 0.0, 0.0,
                     0))
        number[segment["id"]] = len(rows)
    return PriorFrame(space.name, [PriorCamera(np.array(rows, SEGMENT), number[ids])], calibration_hash)


class _NetworkFunction:
    """Left images to segments, by a network."""

    def __init__(self, args, recording) -> None:
        need()
        self._network = SegmentNetwork(args.segment, args.segment_weights,
                                       threads=args.segment_threads, provider=args.segment_provider)
        self.label_space = str(self._network.label_space)
        self._recording = recording
        if hasattr(recording, "keep_colour"):
            recording.keep_colour = True
        self._space = kys_slam.LabelSpace(self.label_space)
        self._hash = recording.camera.calibration_hash()
        # What the file says wrongly of the network shows here, before the run.
        self(np.zeros((recording.camera.height, recording.camera.width, 3), np.uint8))

    def __call__(self, frame: Any) -> PriorFrame:
        image = frame if isinstance(frame, np.ndarray) else left_colour(self._recording, frame)
        ids, segments = self._network.segment(image)
        return to_priors(self._space, ids, segments, self._hash)


class _FolderFunction:
    """Stored segments, by the names of frames."""

    def __init__(self, folder: str) -> None:
        self.label_space = _label_space_of_priors(folder)
        self._read = from_folder(folder)

    def __call__(self, frame: Any) -> Optional[PriorFrame]:
        return self._read(frame)


def check_options(args) -> None:
    """Raises InputError for options that contradict each other."""
    if not args.segment:
        for name in ("weights", "every", "lag", "threads", "provider"):
            if getattr(args, f"segment_{name}") not in (None, 1 if name == "threads" else None):
                raise InputError(f"--segment-{name} needs --segment")
        if args.save_priors:
            raise InputError("--save-priors needs --segment")
        return
    if args.priors:
        raise InputError("--segment and --priors: frames have their priors from one of them")
    if args.segment_lag is not None and args.schedule == "realtime":
        raise InputError("--segment-lag does not apply to --schedule realtime: segments take effect when "
                         "they are there")
    if args.save_priors and Path(args.save_priors).exists() and not args.overwrite \
            and any(Path(args.save_priors).glob("*.kysp")):
        raise InputError(f"{args.save_priors}: has prior files already; --overwrite, or another "
                         "--save-priors")


def pair_of(args, path: Path) -> str:
    """--pair of a KITTI sequence: what is given; for segments of a sequence that has both pairs, the one
    that a network sees in colour, or that stored segments are of; "": the default."""
    segments = getattr(args, "segment", None)
    if args.pair or not segments or not all((path / f"image_{k}").is_dir() for k in range(4)):
        return args.pair
    if not Path(segments).is_dir():
        return "colour"
    stored = next(iter(sorted(Path(segments).glob("*.kysp"))), None)
    colour = kys_slam.open_sequence(path, pair="colour").camera.calibration_hash()
    return "colour" if stored and read_prior(stored).calibration_hash == colour else ""


def open_function(args, recording) -> Optional[Function]:
    """What --segment names; None: it is not given. `label_space` is a setting for it."""
    if not args.segment:
        return None
    if not getattr(recording, "has_images", True):
        raise InputError("--segment needs images; this recording has features only")
    path = Path(args.segment)
    if path.is_dir():
        return _FolderFunction(args.segment)
    try:
        return _NetworkFunction(args, recording)
    except NetworkError as error:
        raise InputError(str(error)) from None


def set_options(args, settings) -> None:
    """--segment-lag and --segment-every as settings; without them what a file or --set says."""
    if args.segment_lag is not None:
        settings["control.segment_lag"] = args.segment_lag
    if args.segment_every is not None:
        settings["control.segment_every"] = args.segment_every
    elif settings.get("control.segment_every") == "0":
        settings["control.segment_every"] = 1


def make_segmenter(args, slam, settings, function: Function) -> Segmenter:
    """The thread, not started. Makes the folder of --save-priors."""
    if args.save_priors:
        try:
            Path(args.save_priors).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot write {args.save_priors}: {error.strerror}") from None
    return Segmenter(slam, function, int(settings.get("control.segment_every")),
                     args.schedule == "realtime", args.save_priors)


def describe(segmenter: Segmenter, reports: list) -> str:
    """One line: how many frames had segments, how late, how long they took."""
    late = [i - report.segments_of for i, report in enumerate(reports) if report.segments_of >= 0]
    if not late:
        return "segments: none took effect"
    line = (f"segments: {len(late)} frames, {np.mean(late):.1f} frames late (at most {max(late)}), "
            f"{1e3 * segmenter.seconds / max(1, segmenter.segmented):.0f} ms each")
    if segmenter.skipped:
        line += f"; {segmenter.skipped} frames passed while the network was busy"
    return line
