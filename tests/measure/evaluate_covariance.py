#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Consistency of the covariances of runs with ground truth.

    evaluate_covariance.py RUN... [--frames 10] [--plot FILE.png]

RUN: output folders with covariance.csv, frames.csv and ground_truth.tum. NEES is the squared error
divided by its covariance, e^T C^-1 e; divided by 6 its mean should be 1, its median 0.89. Kinds:

motion   of a frame since the last one
local    of a frame relative to its reference keyframe
path     over N frames: from both frames along reference keyframes to the one they have in common
sum      over N frames: the motions one after the other, their errors taken as independent

`slow` is the correlation of the errors of successive motions, mean of the six directions: near 1 when
errors are systematic, as those of a poor ground truth are, -0.5 when poses have independent errors.
"""
import argparse
import csv
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "..", "tools", "common"))
import inputs  # noqa: E402

KINDS = ("motion", "local", "path", "sum")


def hat(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def pose(t, q):
    """(4, 4) of position and quaternion x, y, z, w."""
    x, y, z, w = np.asarray(q) / np.linalg.norm(q)
    T = np.eye(4)
    T[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                 [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    T[:3, 3] = t
    return T


def inverse(T):
    M = np.eye(4)
    M[:3, :3] = T[:3, :3].T
    M[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return M


def adjoint(T):
    """An increment [w; v] in frame b as one in frame a, T = T_a_b."""
    A = np.zeros((6, 6))
    A[:3, :3] = A[3:, 3:] = T[:3, :3]
    A[3:, :3] = hat(T[:3, 3]) @ T[:3, :3]
    return A


def error(estimate, truth):
    """Increment [w; v] on the right of the estimate that gives the truth."""
    D = inverse(estimate) @ truth
    axis = np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]]) / 2
    sine = np.linalg.norm(axis)
    angle = np.arctan2(sine, (np.trace(D[:3, :3]) - 1) / 2)
    return np.concatenate([axis * (angle / sine if sine > 1e-12 else 1), D[:3, 3]])


def compose(first, second):
    """Pose and covariance of two relative poses one after the other."""
    A = adjoint(inverse(second[0]))
    return first[0] @ second[0], A @ first[1] @ A.T + second[1]


def nees(estimate, truth, covariance):
    e = error(estimate, truth)
    return e @ np.linalg.solve(covariance, e) / 6


class Run:
    """local, motion: (other, pose, covariance) by frame index; truth: pose by frame index."""

    def __init__(self, folder):
        frames, truth, covariances = (os.path.join(folder, name) for name in
                                      ("frames.csv", "ground_truth.tum", "covariance.csv"))
        with inputs.reading(frames), open(frames, newline="", encoding="utf-8") as file:
            times = {float(r["timestamp"]): int(r["index"]) for r in csv.DictReader(file)}
            if not times:
                inputs.fail(f"{frames}: no frames")
        stamps = np.array(sorted(times))
        self.truth = {}
        with inputs.reading(truth):
            for row in np.loadtxt(truth, ndmin=2):
                nearest = stamps[np.argmin(np.abs(stamps - row[0]))]
                if abs(nearest - row[0]) < 1e-3:  # s
                    self.truth[times[nearest]] = pose(row[1:4], row[4:8])
        self.local, self.motion = {}, {}
        upper = np.triu_indices(6)
        with inputs.reading(covariances), open(covariances, newline="", encoding="utf-8") as file:
            rows = csv.reader(file)
            next(rows, None)
            for r in rows:
                C = np.zeros((6, 6))
                C[upper] = [float(v) for v in r[11:32]]
                C = C + C.T - np.diag(np.diag(C))
                numbers = [float(v) for v in r[4:11]]
                if not (np.isfinite(numbers).all() and np.isfinite(C).all()):
                    inputs.fail(f"{covariances}: frame {r[0]}: a number is not finite")
                kind = {"local": self.local, "motion": self.motion}[r[2]]
                kind[int(r[0])] = (int(r[3]), pose(numbers[:3], numbers[3:]), C)

    def chain(self, frame):
        """The frame, its reference keyframe, that one's, ..."""
        frames = [frame]
        while frames[-1] in self.local and 0 <= self.local[frames[-1]][0] < frames[-1]:
            frames.append(self.local[frames[-1]][0])
        return frames

    def along(self, frames):
        """Pose of frames[0] relative to frames[-1], and its covariance."""
        total = np.eye(4), np.zeros((6, 6))
        for frame in reversed(frames[:-1]):
            total = compose(total, self.local[frame][1:])
        return total

    def path(self, a, b):
        """Pose of frame b relative to frame a by way of reference keyframes; None: no way."""
        from_a, from_b = self.chain(a), self.chain(b)
        common = next((k for k in from_b if k in from_a), None)
        if common is None:
            return None
        T_k_a, C_a = self.along(from_a[:from_a.index(common) + 1])
        T_k_b, C_b = self.along(from_b[:from_b.index(common) + 1])
        T_a_b = inverse(T_k_a) @ T_k_b
        A = adjoint(inverse(T_a_b))
        return T_a_b, A @ C_a @ A.T + C_b

    def sum(self, a, b):
        """The same by the motions in between; None: one is missing."""
        total = np.eye(4), np.zeros((6, 6))
        for frame in range(a + 1, b + 1):
            if frame not in self.motion or self.motion[frame][0] != frame - 1:
                return None
            total = compose(total, self.motion[frame][1:])
        return total

    def nees(self, frames):
        values = {kind: [] for kind in KINDS}
        for kind, poses in (("motion", self.motion), ("local", self.local)):
            for frame, (other, T, C) in poses.items():
                if frame in self.truth and other in self.truth:
                    values[kind].append(nees(T, inverse(self.truth[other]) @ self.truth[frame], C))
        for b in sorted(self.motion):
            a = b - frames
            if a not in self.truth or b not in self.truth or a not in self.motion:
                continue
            true = inverse(self.truth[a]) @ self.truth[b]
            for kind, between in (("path", self.path), ("sum", self.sum)):
                found = between(a, b)
                if found is not None:
                    values[kind].append(nees(found[0], true, found[1]))
        return values

    def slowness(self):
        """Correlation of the errors of successive motions, mean of six directions."""
        errors = [error(T, inverse(self.truth[o]) @ self.truth[f])
                  for f, (o, T, _) in sorted(self.motion.items()) if f in self.truth and o in self.truth]
        if len(errors) < 10:
            return float("nan")
        e = np.array(errors)
        return float(np.mean([np.corrcoef(e[1:, k], e[:-1, k])[0, 1] for k in range(6)]))


def line(name, values, slow=None):
    cells = [f"{np.mean(values[k]):8.2f} {np.median(values[k]):6.2f}" if values[k] else " " * 15
             for k in KINDS]
    return f"{name:16} {len(values['motion']):6} " + " ".join(cells) + (
        "" if slow is None else f" {slow:6.2f}")


def draw(values, file):
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot
    figure, axes = pyplot.subplots(1, len(KINDS), figsize=(14, 3.2), sharey=True)
    x = np.linspace(0, 4, 400)
    density = 6 * (6 * x) ** 2 * np.exp(-3 * x) / 16  # of chi-square with 6 degrees of freedom, / 6
    for axis, kind in zip(axes, KINDS):
        axis.hist(np.minimum(values[kind], 4), bins=40, range=(0, 4), density=True, color="#9bc")
        axis.plot(x, density, color="#a33", label="chi-square / 6")
        axis.set_title(f"{kind}: mean {np.mean(values[kind]):.2f}, median {np.median(values[kind]):.2f}")
        axis.set_xlabel("NEES / 6 (the last bin has all above)")
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(file, dpi=80)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", nargs="+")
    parser.add_argument("--frames", type=int, default=10, help="of path and sum (default 10)")
    parser.add_argument("--plot", metavar="FILE.png", help="histograms of all runs")
    arguments = parser.parse_args()
    if arguments.frames < 1:
        inputs.fail("--frames: at least 1")
    print(f"{'NEES/6':16} {'frames':>6} " + " ".join(f"{k:>8} median" for k in KINDS) + "   slow")
    everything = {kind: [] for kind in KINDS}
    for folder in arguments.run:
        run = Run(folder)
        values = run.nees(arguments.frames)
        for kind in KINDS:
            everything[kind] += values[kind]
        print(line(os.path.basename(os.path.normpath(folder)), values, run.slowness()))
    print(line("all", everything))
    if arguments.plot:
        draw(everything, arguments.plot)


if __name__ == "__main__":
    inputs.run(main)
