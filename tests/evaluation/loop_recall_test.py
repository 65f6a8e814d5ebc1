#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs loop_recall.py on a made-up drive of one and a half rounds of a circle."""
import importlib.util
import math
import os
import subprocess
import sys
import tempfile

SKIPPED = 77
RATE, ROUND, RADIUS = 10, 20.0, 30.0  # Hz, s, m


def table(script, run, edges, loops):
    """The row of a run whose map has these edges, and whose loops are frame: (other, distance)."""
    frames = int(1.5 * ROUND * RATE)
    with open(os.path.join(run, "ground_truth.tum"), "w", encoding="utf-8") as file:
        for i in range(frames):
            turn = 2 * math.pi * i / RATE / ROUND  # about y; driving along z of the camera
            file.write(f"{i / RATE} {-RADIUS * math.cos(turn)} 0 {RADIUS * math.sin(turn)} "
                       f"0 {math.sin(turn / 2)} 0 {math.cos(turn / 2)}\n")
    with open(os.path.join(run, "frames.csv"), "w", encoding="utf-8") as file:
        file.write("index,timestamp,loop,loop_frame,loop_distance_m,loop_gap_m\n")
        for i in range(frames):
            other, distance = loops.get(i, ("", 0))
            file.write(f"{i},{i / RATE},{'closed' if i in loops else ''},{other},{distance},0.5\n")
    with open(os.path.join(run, "graph.csv"), "w", encoding="utf-8") as file:
        file.write("timestamp,other,shared_landmarks,spanning_tree,loop\n1.0,0.0,200,1,0\n")
        file.writelines(f"{a},{b},{shared},0,0\n" for a, b, shared in edges)
    done = subprocess.run([sys.executable, script, run], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [cell.strip() for cell in done.stdout.splitlines()[2].split("|")[2:-1]]


def main():
    if importlib.util.find_spec("numpy") is None:
        print("no numpy")
        return SKIPPED
    script = sys.argv[1]
    with tempfile.TemporaryDirectory() as run:
        # loops closed, of these true, revisits, connected, largest gap
        assert table(script, run, [], {}) == ["0", "0", "1", "0", "0.00"]
        assert table(script, run, [(22.0, 2.0, 40)], {}) == ["0", "0", "1", "1", "0.00"]
        assert table(script, run, [(22.0, 2.0, 14)], {})[3] == "0"  # too few landmarks
        assert table(script, run, [(22.0, 6.0, 40)], {})[3] == "0"  # another place
        assert table(script, run, [(22.0, 19.0, 40)], {})[3] == "0"  # the same visit
        true = {220: (20, 0.1)}
        assert table(script, run, [(22.0, 2.0, 40)], true) == ["1", "1", "1", "1", "0.50"]
        false = {220: (60, 0.1)}  # truly far apart
        assert table(script, run, [], false)[:2] == ["1", "0"]
        os.unlink(os.path.join(run, "graph.csv"))
        done = subprocess.run([sys.executable, script, run], capture_output=True, text=True,
                              check=False)
        assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    return 0


if __name__ == "__main__":
    sys.exit(main())
