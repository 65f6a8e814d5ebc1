#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Keypoints and stereo matches of a frame, coloured by tier (Supplement H).

    tier_picture.py SEQUENCE --priors DIR --output FILE.png [--mode kys] [--frame 30]

Needs the Python package kys_slam (the build's python folder in PYTHONPATH). Upper picture: keypoints by
how they compare with the landmark they see; lower pictures: stereo matches by how the priors of the
two keypoints compare.
"""
import argparse
import os
import sys

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.collections import LineCollection  # noqa: E402

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "python",
                                "kys_slam"))
import kysp  # noqa: E402

COLOURS = {"same instance": "#46dc5a", "cross instance": "#f0dc3c", "cross class": "#f58c28",
           "bypassed": "#78beff", "gated": "#e63232", "filtered": "#e63232", "none": "#a0a0a0"}


def observe(kys_slam, sequence, priors, mode, number):
    """What was seen in a frame, and its images; None when there are too few frames."""
    settings = kys_slam.Settings({"kys.mode": mode})
    slam = kys_slam.System(sequence.camera, settings, "sequential", priors)
    last = []
    slam.set_observer(lambda seen: last.__setitem__(slice(None), [seen]))
    for i, frame in enumerate(sequence):
        slam.feed_frame(frame)
        if i == number:
            return last[0], frame
    return None


def priors_at(kys_slam, prior, points, shares_instances):
    """What a camera's prior file says of points (N, 2) px, as the matcher looks it up."""
    height, width = prior.segment_map.shape
    u, v = np.floor(points.T + 0.5)
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    u, v = np.where(inside, u, 0).astype(int), np.where(inside, v, 0).astype(int)
    number = np.where(inside, prior.segment_map[v, u], 0)
    void = np.zeros(1, prior.segments.dtype)
    void["label"] = kysp.VOID_LABEL
    segments = np.concatenate([void, prior.segments])[number]
    instances = segments["instance"] % kysp.RIGHT_INSTANCES if shares_instances else segments["instance"]
    dynamic = (segments["flags"] & kysp.DYNAMIC) != 0
    motion = np.zeros(len(number)) if prior.motion is None else np.where(dynamic, prior.motion[v, u], 0)
    column = lambda values, kind: np.ascontiguousarray(values, kind)
    return kys_slam.Priors(column(segments["label"], np.uint16), column(instances, np.int32),
                           column(segments["scale"], np.float32), column(motion, np.float32), dynamic)


def stereo_tiers(kys_slam, seen, frame, camera, priors, mode):
    """Ends (N, 2, 2) px of the stereo matches in the two images, and their tiers."""
    file = kys_slam.read_prior(f"{priors}/{frame.name}.kysp")
    deep = seen.depths > 0
    left = seen.keypoints[deep]
    right = left - np.stack([camera.fx * camera.baseline / seen.depths[deep],
                             np.zeros(deep.sum())], axis=-1)
    sides = [priors_at(kys_slam, prior, ends, file.shares_instances)
             for ends, prior in zip((left, right), file.cameras)]
    none = np.zeros((len(left), 32), np.uint8)  # descriptors do not change the tier
    _, tiers = kys_slam.DistanceModel(mode, file.label_space).distances(
        none, sides[0], none, sides[1], stereo=True)
    return np.stack([left, right], axis=1), np.array(kys_slam.TIERS)[np.diagonal(tiers)]


def draw(kys_slam, seen, frame, ends, tiers, output):
    names = np.array(kys_slam.TIERS)[seen.tiers]
    height, width = frame.left.shape
    figure, (above, below) = plt.subplots(2, 1, figsize=(10, 10 * 3.15 * height / width + 0.6),
                                          height_ratios=[1, 2.08])
    above.imshow(frame.left, cmap="gray", vmin=0, vmax=255)
    for tier in ("none", *[t for t in kys_slam.TIERS if t != "none"]):
        at = names == tier
        if at.any():
            above.scatter(*seen.keypoints[at].T, s=5, color=COLOURS[tier],
                          label=f"{tier} ({at.sum()})")
    above.set_title("keypoints, by their landmark", fontsize=9)
    gap = 6
    below.imshow(np.vstack([frame.left, np.full((gap, width), 255, np.uint8), frame.right]),
                 cmap="gray", vmin=0, vmax=255)
    shift = np.array([0, height + gap])
    for tier in kys_slam.TIERS:
        at = tiers == tier
        if at.any():
            lines = np.stack([ends[at, 0], ends[at, 1] + shift], axis=1)
            below.add_collection(LineCollection(lines, colors=COLOURS[tier], linewidths=0.3, alpha=0.6))
            for points in (lines[:, 0], lines[:, 1]):
                below.scatter(*points.T, s=4, color=COLOURS[tier])
            below.plot([], [], color=COLOURS[tier], label=f"{tier} ({at.sum()})")
    below.set_title("stereo matches, left above right", fontsize=9)
    for axis in (above, below):
        axis.set_axis_off()
        axis.legend(fontsize=7, loc="upper right", ncols=3)
    figure.tight_layout()
    figure.savefig(output, dpi=110)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sequence")
    parser.add_argument("--priors", required=True)
    parser.add_argument("--output", required=True, metavar="FILE.png")
    parser.add_argument("--mode", default="kys")
    parser.add_argument("--frame", type=int, default=30)
    options = parser.parse_args()
    try:
        import kys_slam
    except ImportError:
        print("tier_picture.py: the Python package kys_slam is not there", file=sys.stderr)
        return 2
    try:
        sequence = kys_slam.open_sequence(options.sequence, frames=options.frame + 1)
        number = min(options.frame, len(sequence) - 1)
        seen, frame = observe(kys_slam, sequence, options.priors, options.mode, number)
        ends, tiers = stereo_tiers(kys_slam, seen, frame, sequence.camera, options.priors,
                                   options.mode)
        draw(kys_slam, seen, frame, ends, tiers, options.output)
    except (kys_slam.InputError, OSError) as error:
        print(f"tier_picture.py: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
