#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What binary descriptors lose against the floats they are made of: precision and recall of matching by
mutual nearest neighbours, on stereo pairs and on pairs of frames.

    tools/perception/evaluate_features.py SEQUENCE [LEFT RIGHT] --features MODEL.yaml
        [--calibration FILE] [--every 10] [--later 3]

Matches are judged by geometry alone: dense disparity of the pair; between frames dense flow, or,
where the recording has true poses, that disparity moved by them. Precision: share of the matches of
features whose place in the other image is known that are within 1.5 px of it. Recall: share of the features
with a partner there that are matched to within 1.5 px.
"""

import argparse
import sys

import numpy as np

import kys_slam
from kys_slam import InputError, binarise
from kys_slam.feature_network import FeatureNetwork
from kys_slam.feature_pairs import flow_field, hamming, mutual_matches, partners, stereo_field
from kys_slam.segment_network import NetworkError

def moved_field(field, camera, T_second_first):
    """Where pixels of the first left image are in the second one, by their disparities."""
    height, width = field.shape[:2]
    rows, columns = np.indices((height, width), float)
    disparity = columns - field[:, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        z = camera.fx * camera.baseline / disparity
        z[disparity < 1] = np.nan  # too far to tell
        p = np.stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z])
        q = np.tensordot(T_second_first[:3, :3], p, 1) + T_second_first[:3, 3, None, None]
        u, v = camera.fx * q[0] / q[2] + camera.cx, camera.fy * q[1] / q[2] + camera.cy
    inside = (q[2] > 0) & (u >= 0) & (v >= 0) & (u < width) & (v < height)
    return np.where(inside[:, :, None], np.stack([u, v], axis=2), np.nan)


class Counts:
    """Of one kind of descriptor on one kind of pairs."""

    def __init__(self):
        self.right = self.judged = self.found = self.possible = 0

    def add(self, distance, pairs):
        mutual, right = mutual_matches(pairs, distance)
        self.right += int(np.count_nonzero(right))
        self.found += int(np.count_nonzero(right[pairs.matching[:, 0]]))
        # A match of a feature that leaves the image or is hidden cannot be judged by its place.
        self.judged += int(np.count_nonzero(mutual & pairs.known))
        self.possible += len(pairs.matching)

    def __str__(self):
        return f"{100 * self.right / max(1, self.judged):6.1f} {100 * self.found / max(1, self.possible):6.1f}"


def distances(a, b, features):
    """{kind: (N, M) distances} of float descriptors."""
    result = {"floats": 1 - a["descriptors"] @ b["descriptors"].T}
    x, y = (features.bits(f["descriptors"]) for f in (a, b))
    for bits in (256, 128, 64):
        result[f"{bits} bits"] = hamming(x[:, :bits // 8], y[:, :bits // 8])
    signs = (binarise(f["descriptors"], features.seed, features.centre or None) for f in (a, b))
    result["256 signs"] = hamming(*signs)
    return result


def open_recording(args):
    if len(args.input) == 1:
        return kys_slam.open_sequence(args.input[0])
    return kys_slam.open_image_pair(*args.input, kys_slam.read_stereo_rig(args.calibration), rate=args.rate)


def pose_of(recording, time):
    if recording.ground_truth is None:
        return None
    times, poses = recording.ground_truth
    at = int(np.argmin(np.abs(times - time)))
    return poses[at] if abs(times[at] - time) < 0.01 else None


def measure(args):
    recording = open_recording(args)
    network = FeatureNetwork(args.features, args.features_weights)
    features = network.features(args.count)
    settings = kys_slam.Settings({"orb.features": network.most})
    table = {}
    wanted = {}  # frames that are waited for
    for index, frame in enumerate(recording):
        start, end = index % args.every == 0, wanted.pop(index, None)
        if not (start or end):
            continue
        left, right = np.asarray(frame.left), np.asarray(frame.right)
        found = features.raw(left)
        orb, orb_right = kys_slam._core._orb_features(left, right, settings)

        def add(kind, field, first, second, first_orb, second_orb):
            pairs = partners(first, second, field)
            for name, distance in distances(first, second, features).items():
                table.setdefault((kind, name), Counts()).add(distance, pairs)
            pairs = partners(first_orb, second_orb, field)
            table.setdefault((kind, "ORB"), Counts()).add(
                hamming(first_orb["descriptors"], second_orb["descriptors"]), pairs)

        pose = pose_of(recording, frame.timestamp)
        if end:
            before, first, first_orb, field, pose_before = end
            if pose is not None and pose_before is not None:
                moved = moved_field(field, recording.camera, np.linalg.inv(pose) @ pose_before)
            else:
                moved = flow_field(before, left)
            add("frames", moved, first, found, first_orb, orb)
        if start:
            field = stereo_field(left, right)
            add("stereo", field, found, features.raw(right), orb, orb_right)
            wanted[index + args.later] = (left, found, orb, field, pose)
    print(f"{recording.name}: precision, recall (%) of mutual nearest neighbours; {network.most} features, "
          f"frames {args.later} apart")
    for kind in ("stereo", "frames"):
        for name in ("floats", "256 bits", "128 bits", "64 bits", "256 signs", "ORB"):
            if (kind, name) in table:
                print(f"{kind:7} {name:9} {table[kind, name]}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("input", nargs="+", help="a sequence, or folders LEFT RIGHT with --calibration")
    parser.add_argument("--features", required=True, metavar="MODEL.yaml")
    parser.add_argument("--features-weights", metavar="FILE.onnx")
    parser.add_argument("--count", type=int, help="features per image (default: of MODEL.yaml)")
    parser.add_argument("--calibration", nargs="+")
    parser.add_argument("--rate", type=float, default=10)
    parser.add_argument("--every", type=int, default=10)
    parser.add_argument("--later", type=int, default=3)
    args = parser.parse_args()
    try:
        measure(args)
    except (InputError, NetworkError) as error:
        print(f"evaluate_features: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
