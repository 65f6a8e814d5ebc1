#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""evaluate_integrity on a run that is made up: a camera that goes 1 m per frame, and an estimate that
stands from frame 20 to 29."""
import os
import subprocess
import sys
import tempfile

try:
    import numpy  # noqa: F401
except ImportError:
    print("numpy is missing")
    sys.exit(77)

HERE = os.path.dirname(os.path.abspath(__file__))
PROGRAM = os.path.join(HERE, "evaluate_integrity.py")
FRAMES = 60


def write_run(folder, flagged):
    """flagged: {frame: reason}."""
    with open(os.path.join(folder, "frames.csv"), "w", encoding="utf-8") as frames, \
            open(os.path.join(folder, "trajectory.tum"), "w", encoding="utf-8") as estimate, \
            open(os.path.join(folder, "ground_truth.tum"), "w", encoding="utf-8") as truth:
        frames.write("index,timestamp,integrity,integrity_reason\n")
        for k in range(FRAMES):
            stands = max(0, min(k, 29) - 19)  # frames in which it stood up to now
            frames.write(f"{k},{k / 10},{'degraded' if k in flagged else 'ok'},\"{flagged.get(k, '')}\"\n")
            estimate.write(f"{k / 10} {k - stands} 0 0 0 0 0 1\n")
            truth.write(f"{k / 10} {k} 0 0 0 0 0 1\n")


def run(folder):
    return subprocess.run([sys.executable, PROGRAM, folder], capture_output=True, text=True, check=False)


def numbers(done):
    assert done.returncode == 0, done.stderr
    return [int(v) for v in done.stdout.splitlines()[-1].split()[1:]]


def main():
    with tempfile.TemporaryDirectory() as folder:
        # Off: frames 20 to 38, whose ten frames before contain some in which it stood; 10 to 19 and 39
        # to 59 are sound.
        write_run(folder, {})
        assert numbers(run(folder)) == [19, 19, 31, 0]
        # A flag on frame 20 tells 20 to 29; one on frame 50 is false.
        write_run(folder, {20: "few landmarks", 50: "few landmarks"})
        assert numbers(run(folder)) == [19, 9, 31, 1]
        assert "2 few landmarks" in run(folder).stdout
        with open(os.path.join(folder, "frames.csv"), "w", encoding="utf-8") as frames:
            frames.write("index,timestamp\n0,0\n")
        done = run(folder)
        assert done.returncode == 2 and "integrity" in done.stderr, done.stderr
    print("passed")


main()
