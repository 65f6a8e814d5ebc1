#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Consistency of the covariances of keyframes of refined maps with ground truth.

    kys-slam map refine town.map -o town/refined.map --covariance
    kys-slam map info town/refined.map --keyframes town/keyframes.tum
    evaluate_keyframes.py town ... --truth TRUTH.tum ...

A folder has covariances.csv and keyframes.tum; the truth (poses T_w_c, TUM) is one file for all of them,
or one each. NEES is the squared error of a pose relative to the first keyframe of its sub-map, divided by
its covariance, e^T C^-1 e; divided by 6 its mean should be 1. Prints that mean of every folder, and their
mean and standard deviation.
"""
import argparse
import csv
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)
from evaluate_covariance import inputs, inverse, pose  # noqa: E402
import evaluate_covariance  # noqa: E402


def read_poses(file):
    """(4, 4) by time stamp, s."""
    with inputs.reading(file):
        return {row[0]: pose(row[1:4], row[4:8]) for row in np.loadtxt(file, ndmin=2)}


def nearest(poses, time, file):
    stamp = min(poses, key=lambda t: abs(t - time), default=np.inf)
    if abs(stamp - time) > 1e-3:
        inputs.fail(f"{file}: no pose at {time}")
    return poses[stamp]


def nees_of_map(folder, truth_file):
    """NEES / 6 of every keyframe that is not held."""
    file = os.path.join(folder, "covariances.csv")
    tum = os.path.join(folder, "keyframes.tum")
    poses, truth = read_poses(tum), read_poses(truth_file)
    upper = np.triu_indices(6)
    with inputs.reading(file), open(file, newline="", encoding="utf-8") as lines:
        rows = list(csv.reader(line for line in lines if not line.startswith("#")))[1:]
        times = {row[0]: float(row[1]) for row in rows}
        result = []
        for row in rows:
            if row[0] == row[2]:
                continue
            C = np.zeros((6, 6))
            C[upper] = [float(v) for v in row[3:24]]
            C = C + C.T - np.diag(np.diag(C))
            if not np.isfinite(C).all():
                inputs.fail(f"{file}: keyframe {row[0]}: a number is not finite")
            here, first = times[row[0]], times[row[2]]
            T_c_first = inverse(nearest(poses, here, tum)) @ nearest(poses, first, tum)
            true = inverse(nearest(truth, here, truth_file)) @ nearest(truth, first, truth_file)
            # The increment is on the left: on the right of the inverse.
            result.append(evaluate_covariance.nees(inverse(T_c_first), inverse(true), C))
    if not result:
        inputs.fail(f"{file}: no keyframes")
    return result


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", metavar="FOLDER")
    parser.add_argument("--truth", nargs="+", required=True)
    arguments = parser.parse_args()
    truths = arguments.truth * (len(arguments.folders) if len(arguments.truth) == 1 else 1)
    if len(truths) != len(arguments.folders):
        parser.error("--truth: one file, or one for each folder")
    means = []
    for folder, truth in zip(arguments.folders, truths):
        values = nees_of_map(folder, truth)
        means.append(np.mean(values))
        print(f"{folder}: {len(values)} keyframes, NEES/6 {means[-1]:.2f}")
    print(f"mean of {len(means)}: {np.mean(means):.2f}, standard deviation {np.std(means):.2f}")


if __name__ == "__main__":
    inputs.run(main)
