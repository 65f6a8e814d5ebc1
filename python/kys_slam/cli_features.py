# SPDX-License-Identifier: BSD-3-Clause
"""The options --features... of `kys-slam run`, and the command `kys-slam features`: distances of an
extractor's descriptors."""

import argparse
from itertools import islice
from pathlib import Path
from typing import Optional

import numpy as np

import kys_slam
from kys_slam import Features, InputError
from kys_slam.cli_errors import library_warns
from kys_slam.segment_network import NetworkError, need

_LATER = 3  # frames, between those that are compared over time


def check_options(args) -> None:
    """Raises InputError for options that contradict each other."""
    if args.features:
        return
    for name in ("weights", "count"):
        if getattr(args, f"features_{name}") is not None:
            raise InputError(f"--features-{name} needs --features")
    if args.features_threads != 1:
        raise InputError("--features-threads needs --features")


def open_features(args, recording) -> Optional[Features]:
    """What --features names; None: ORB."""
    if not args.features:
        return None
    if not getattr(recording, "has_images", True):
        raise InputError("--features needs images; this recording has features of its own")
    from kys_slam.feature_network import FeatureNetwork
    try:
        need()
        network = FeatureNetwork(args.features, args.features_weights, threads=args.features_threads)
        features = network.features(args.features_count)
        # What the file says wrongly of the network shows here, before the run.
        features(np.zeros((recording.camera.height, recording.camera.width), np.uint8))
    except NetworkError as error:
        raise InputError(str(error)) from None
    return features


def features_command(args) -> int:
    """Measures and prints, or writes, the distances. Returns an exit status."""
    from kys_slam.cli_input import open_recording
    from kys_slam.feature_pairs import DistanceCounts, flow_field, stereo_field
    need()
    check_options(args)
    if args.write and not args.features:
        raise InputError("--write needs --features: ORB's distances are part of the program")
    with library_warns():
        recording = open_recording(argparse.Namespace(**{**vars(args), "frames": None}))
        if not recording.has_images:
            raise InputError(f"{recording.name}: holds features; descriptors are measured in images")
        features = open_features(args, recording)
        settings = kys_slam.Settings()
        counts = DistanceCounts()
        before = []  # left images of the last frames with their features
        for frame in islice(recording, args.frames):
            left, right = np.asarray(frame.left), np.asarray(frame.right)
            if features:
                of_left, of_right = features(left), features(right)
            else:
                of_left, of_right = kys_slam._core._orb_features(left, right, settings)
            counts.add(of_left, of_right, stereo_field(left, right))
            if len(before) == _LATER:
                image, found = before.pop(0)
                counts.add(found, of_left, flow_field(image, left))
            before.append((left, of_left))
    text = _as_yaml(counts, recording.name)
    print(text, end="")
    if args.write:
        _write(Path(args.features), text)
    return 0


def _as_yaml(counts, name: str) -> str:
    lines = [f"# Bits; measured on {name}: {counts.matching.sum()} pairs that show the same point, "
             f"{counts.other.sum()} that do not (kys-slam features).", "distances:"]
    for key, values in counts.quantiles().items():
        lines.append(f"  {key}: [{', '.join(f'{v:g}' for v in values)}]")
    return "\n".join(lines) + "\n"


def _write(file: Path, text: str) -> None:
    """In place of the distances at the end of a file, or behind what is there."""
    try:
        old = file.read_text(encoding="utf-8").splitlines()
        is_start = lambda k: old[k].startswith("distances:")
        start = next((k for k in range(len(old)) if is_start(k)), None)
        if start is not None:
            end = start + 1
            while end < len(old) and old[end].startswith((" ", "\t")):
                end += 1
            start -= start > 0 and old[start - 1].startswith("# Bits; measured on ")
            del old[start:end]
        file.write_text("".join(f"{line}\n" for line in old) + text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {file}: {error.strerror}") from None
