#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""evaluate_covariance on runs that are made up: errors drawn with the covariance that they state have
a NEES/6 of one; errors twice as large of four."""
import os
import subprocess
import sys
import tempfile

try:
    import numpy as np
except ImportError:
    print("numpy is missing")
    sys.exit(77)

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)
import evaluate_covariance as tool  # noqa: E402
from made_up_poses import exponential, numbers  # noqa: E402

FRAMES = 400


def write_run(folder, factor):
    """Every frame relative to the one before, which is a keyframe; errors are independent."""
    rng = np.random.default_rng(3)
    root = np.diag([2e-4, 3e-4, 1e-4, 0.004, 0.002, 0.006]) @ (np.eye(6) + 0.3 * np.tri(6, k=-1))
    C = root @ root.T
    step = exponential(np.array([0.002, 0.01, -0.003, 0.05, -0.02, 0.8]))
    truth = np.eye(4)
    upper = np.triu_indices(6)
    with open(os.path.join(folder, "frames.csv"), "w", encoding="utf-8") as frames, \
            open(os.path.join(folder, "ground_truth.tum"), "w", encoding="utf-8") as poses, \
            open(os.path.join(folder, "covariance.csv"), "w", encoding="utf-8") as rows:
        frames.write("index,timestamp\n")
        rows.write("index,timestamp,kind,other,...\n")
        for k in range(FRAMES):
            frames.write(f"{k},{k / 10}\n")
            poses.write(" ".join([str(k / 10), *numbers(truth)]) + "\n")
            truth = truth @ step
            # T exp(d) is the truth.
            estimate = step @ tool.inverse(exponential(factor * root @ rng.standard_normal(6)))
            if k + 1 < FRAMES:
                for kind in ("local", "motion"):
                    rows.write(",".join([str(k + 1), str((k + 1) / 10), kind, str(k), *numbers(estimate),
                                         *(f"{v:.9e}" for v in C[upper])]) + "\n")


def main():
    for factor, expected in ((1, 1), (2, 4)):
        with tempfile.TemporaryDirectory() as folder:
            write_run(folder, factor)
            run = tool.Run(folder)
            values = run.nees(10)
            assert len(values["motion"]) == FRAMES - 1 and len(values["path"]) > FRAMES - 20
            # Standard deviation of the mean: sqrt(2 / 6 / 399) = 0.029; ten times as few independent
            # windows of ten frames: 0.09.
            assert abs(np.mean(values["motion"]) / expected - 1) < 0.12, np.mean(values["motion"])
            assert abs(np.median(values["motion"]) / expected - 0.891) < 0.15
            for kind in ("path", "sum"):
                assert abs(np.mean(values[kind]) / expected - 1) < 0.4, (kind, np.mean(values[kind]))
            assert np.allclose(values["path"], values["sum"])
            assert abs(run.slowness()) < 0.15
            program = [sys.executable, os.path.join(HERE, "evaluate_covariance.py")]
            done = subprocess.run(program + [folder], capture_output=True, text=True, check=False)
            assert done.returncode == 0 and "motion" in done.stdout, done.stderr
            with open(os.path.join(folder, "covariance.csv"), "a", encoding="utf-8") as rows:
                rows.write("5,0.5,motion,4,nan\n")
            done = subprocess.run(program + [folder], capture_output=True, text=True, check=False)
            assert done.returncode == 2 and "covariance.csv" in done.stderr, done.stderr
    print("passed")


main()
