# SPDX-License-Identifier: BSD-3-Clause
"""The options --features... of `kys-slam run`, and the command `kys-slam features`: distances of an
extractor's descriptors."""

import argparse
from itertools import islice
from pathlib import Path
from typing import Any, Callable, Iterable, Iterator, Optional, Tuple

import numpy as np

import kys_slam
from kys_slam import Features, InputError
from kys_slam.cli_errors import library_warns
from kys_slam.segment_network import NetworkError, need

_LATER = 3  # frames, between those that are compared over time
_PERIODS = (0.0, 4.0, 2.8, 2.0)  # of bits, tried: standard deviations of a projection; 0: signs
_EVERY = 4  # pairs, one is used to choose among them


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
    need()
    from kys_slam.feature_pairs import DistanceCounts, hamming
    check_options(args)
    if args.write and not args.features:
        raise InputError("--write needs --features: ORB's distances are part of the program")
    with library_warns():
        recording = open_recording(argparse.Namespace(**{**vars(args), "frames": None}))
        if not recording.has_images:
            raise InputError(f"{recording.name}: holds features; descriptors are measured in images")
        features = open_features(args, recording)
        pairs = list(_pairs(islice(recording, args.frames), _extractor(features)))
    if features and pairs and pairs[0][1].dtype != np.uint8:
        _fit_bits(features, pairs)
    counts = DistanceCounts()
    for geometry, first, second in pairs:
        counts.add(geometry, hamming(*(_bits(d, features) for d in (first, second))))
    text = _as_yaml(counts, recording.name, features)
    print(text, end="")
    if args.write:
        _write(Path(args.features), text)
    return 0


def _extractor(features: Optional[Features]) -> Callable:
    """(left, right) images to the features of both."""
    if features:
        return lambda left, right: (features.raw(left), features.raw(right))
    settings = kys_slam.Settings()
    return lambda left, right: kys_slam._core._orb_features(left, right, settings)


def _pairs(frames: Iterable, extract: Callable) -> Iterator[Tuple[Any, np.ndarray, np.ndarray]]:
    """(Partners, descriptors of the first image, of the second) of stereo pairs and of frames."""
    from kys_slam.feature_pairs import flow_field, partners, stereo_field
    before: list = []  # left images of the last frames with their features
    for frame in frames:
        left, right = np.asarray(frame.left), np.asarray(frame.right)
        of_left, of_right = extract(left, right)
        yield (partners(of_left, of_right, stereo_field(left, right)), of_left["descriptors"],
               of_right["descriptors"])
        if len(before) == _LATER:
            image, found = before.pop(0)
            yield (partners(found, of_left, flow_field(image, left)), found["descriptors"],
                   of_left["descriptors"])
        before.append((left, of_left))


def _fit_bits(features: Features, pairs: list) -> None:
    """Sets the centre, the mean of the descriptors, and the period by which most of the pairs that show the
    same point are mutual nearest neighbours."""
    from kys_slam.feature_pairs import hamming, mutual_matches
    floats = np.concatenate([first for _, first, _ in pairs]).astype(np.float64)
    if not len(floats):
        return
    mean = floats.mean(axis=0)
    deviation = float(np.sqrt(np.square(floats - mean).mean()))  # of any projection, on average
    features.centre = [float(c) for c in np.round(mean, 6)]

    def found(factor: float) -> int:
        features.period = float(f"{factor * deviation:.4g}")
        used = [pair for pair in pairs[::_EVERY] if len(pair[1]) and len(pair[2])]
        right = (mutual_matches(geometry, hamming(_bits(a, features), _bits(b, features)))[1]
                 for geometry, a, b in used)
        return sum(int(np.count_nonzero(r)) for r in right)

    best = max(_PERIODS if deviation > 0 else (0.0,), key=found)  # the first of equal ones
    features.period = float(f"{best * deviation:.4g}")


def _bits(descriptors: np.ndarray, features: Optional[Features]) -> np.ndarray:
    return descriptors if descriptors.dtype == np.uint8 else features.bits(descriptors)


def _as_yaml(counts, name: str, features: Optional[Features]) -> str:
    lines = [f"# Bits; measured on {name}: {counts.matching.sum()} pairs that show the same point, "
             f"{counts.other.sum()} that do not (kys-slam features).", "distances:"]
    for key, values in counts.quantiles().items():
        lines.append(f"  {key}: [{', '.join(f'{v:g}' for v in values)}]")
    if features and features.centre:
        lines.append(f"period: {features.period:g}")
        lines.append(f"centre: [{', '.join(f'{v:g}' for v in features.centre)}]")
    return "\n".join(lines) + "\n"


def _write(file: Path, text: str) -> None:
    """Behind what else is in the file."""
    kept, drop = [], False
    try:
        for line in file.read_text(encoding="utf-8").splitlines():
            if not line.startswith((" ", "\t")):
                drop = line.startswith(("distances:", "period:", "centre:", "# Bits; measured on "))
            if not drop:
                kept.append(f"{line}\n")
        file.write_text("".join(kept) + text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {file}: {error.strerror}") from None
