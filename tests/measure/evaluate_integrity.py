#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Flags of integrity against ground truth.

    evaluate_integrity.py RUN... [--frames 10] [--error 0.3]

RUN: output folders with frames.csv, trajectory.tum and ground_truth.tum. A frame is off when its motion
over N frames is wrong by more than the error (m). It is missed when none of these N frames has a flag
(degraded or contradicted). A flag on a frame that is not off is false.
"""
import argparse
import collections
import csv
import os

import numpy as np

from evaluate_covariance import inputs, inverse, pose


def poses_of(file):
    """Pose (4, 4) by time stamp, rounded to 0.1 ms."""
    with inputs.reading(file):
        rows = np.loadtxt(file, ndmin=2)
    return {round(row[0], 4): pose(row[1:4], row[4:8]) for row in rows}


def frames_of(file):
    """[(time stamp, whether it has a flag, reason)]."""
    with inputs.reading(file), open(file, newline="", encoding="utf-8") as table:
        rows = list(csv.DictReader(table))
        if rows and "integrity" not in rows[0]:
            inputs.fail(f"{file}: no column 'integrity'")
        return [(round(float(r["timestamp"]), 4), r["integrity"] not in ("", "ok"), r["integrity_reason"])
                for r in rows]


def judge(frames, estimate, truth, span, bound):
    """Counter of off, missed, sound, false."""
    counts = collections.Counter(off=0, missed=0, sound=0, false=0)
    for i in range(span, len(frames)):
        a, b = frames[i - span][0], frames[i][0]
        if not all(t in poses for t in (a, b) for poses in (estimate, truth)):
            continue
        moved = inverse(estimate[a]) @ estimate[b]
        should = inverse(truth[a]) @ truth[b]
        if np.linalg.norm((inverse(should) @ moved)[:3, 3]) > bound:
            counts["off"] += 1
            counts["missed"] += not any(flag for _, flag, _ in frames[i - span + 1:i + 1])
        else:
            counts["sound"] += 1
            counts["false"] += frames[i][1]
    return counts


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", nargs="+")
    parser.add_argument("--frames", type=int, default=10, help="frames of a motion (default 10)")
    parser.add_argument("--error", type=float, default=0.3, help="m (default 0.3)")
    arguments = parser.parse_args()
    if arguments.frames < 1 or not arguments.error > 0:
        inputs.fail("--frames must be at least 1, --error above 0")
    total = collections.Counter()
    print(f"{'run':24} {'off':>5} {'missed':>6} {'sound':>6} {'false':>5}  reasons")
    for folder in arguments.run:
        frames = frames_of(os.path.join(folder, "frames.csv"))
        counts = judge(frames, *(poses_of(os.path.join(folder, name)) for name in
                                 ("trajectory.tum", "ground_truth.tum")), arguments.frames, arguments.error)
        total += counts
        reasons = collections.Counter(reason for _, flag, reason in frames if flag)
        print(f"{os.path.basename(os.path.normpath(folder)):24} {counts['off']:5} {counts['missed']:6} "
              f"{counts['sound']:6} {counts['false']:5}  "
              + ", ".join(f"{n} {reason}" for reason, n in sorted(reasons.items())))
    print(f"{'all':24} {total['off']:5} {total['missed']:6} {total['sound']:6} {total['false']:5}")


if __name__ == "__main__":
    inputs.run(main)
