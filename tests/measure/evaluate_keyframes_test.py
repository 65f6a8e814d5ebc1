#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""evaluate_keyframes on maps that are made up: errors drawn with the covariance that they state have a
NEES/6 of one; errors twice as large of four."""
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

KEYFRAMES = 300


def write_map(folder, factor):
    rng = np.random.default_rng(5)
    root = np.diag([2e-4, 3e-4, 1e-4, 0.004, 0.002, 0.006]) @ (np.eye(6) + 0.3 * np.tri(6, k=-1))
    C = root @ root.T
    step = exponential(np.array([0.002, 0.01, -0.003, 0.05, -0.02, 0.8]))
    truth = exponential(np.array([0.1, -0.2, 0.3, 4, 5, 6]))  # T_w_c of the first one
    start = truth
    tum, true, rows = "", "", "# comment\nkeyframe,timestamp_s,relative_to,...\n"
    for k in range(KEYFRAMES):
        true += " ".join([str(k / 10), *numbers(truth)]) + "\n"
        d = np.zeros(6) if k == 0 else factor * root @ rng.standard_normal(6)
        T_c_first = tool.inverse(truth) @ start
        # x_c -> exp(r) x_c + t
        moved = (exponential(d) if k > 0 else np.eye(4)) @ T_c_first
        # The map is in the frame of its first keyframe.
        tum += " ".join([str(k / 10), *numbers(tool.inverse(moved))]) + "\n"
        entries = C[np.triu_indices(6)] * (k > 0)
        rows += ",".join([str(7 + k), f"{k / 10:.6f}", "7", *[f"{v:.12g}" for v in entries]]) + "\n"
        truth = truth @ step
    for name, text in (("keyframes.tum", tum), ("truth.tum", true), ("covariances.csv", rows)):
        with open(os.path.join(folder, name), "w", encoding="utf-8") as file:
            file.write(text)


def evaluate(folder, *more):
    return subprocess.run([sys.executable, os.path.join(HERE, "evaluate_keyframes.py"), folder, "--truth",
                           os.path.join(folder, "truth.tum"), *more], capture_output=True, text=True, check=False)


def main():
    for factor in (1, 2):
        with tempfile.TemporaryDirectory() as folder:
            write_map(folder, factor)
            found = evaluate(folder)
            assert found.returncode == 0, found.stderr
            mean = float(found.stdout.splitlines()[-1].split(":")[1].split(",")[0])
            # 299 draws of six: a standard deviation of 0.033 of the mean.
            assert abs(mean / factor**2 - 1) < 0.15, found.stdout
            assert f"{KEYFRAMES - 1} keyframes" in found.stdout
            with open(os.path.join(folder, "truth.tum"), encoding="utf-8") as file:
                lines = file.readlines()
            with open(os.path.join(folder, "truth.tum"), "w", encoding="utf-8") as file:
                file.writelines(lines[:-1])
            refused = evaluate(folder)
            assert refused.returncode == 2 and "no pose at" in refused.stderr, refused


if __name__ == "__main__":
    main()
