#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Which loops of a run exist, and which of those that exist it found.

Reads `frames.csv`, `graph.csv` and `ground_truth.tum` of output folders of run_stereo_kitti or
run_stereo_euroc.

A *revisit* begins at a frame from which, for at least --least seconds, the camera is within --radius
of a place where it was at least --gap seconds before, looking the same way within --angle. Frames
less than --gap seconds apart belong to one revisit. A revisit is *connected* when a keyframe from it, or
from --gap seconds after it, shares landmarks (at least 15) with one that is --gap seconds older and
was truly within twice --radius of it: after a loop was closed, or because the tracker recognised what
it had seen before and no loop was needed. A closed loop is *true* when the distance of its two frames,
as verified when it was closed, differs from the true one by no more than --error.
"""

import argparse
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import inputs  # noqa: E402


FRAMES = {"index": str, "timestamp": float, "loop": str, "loop_frame": str, "loop_gap_m": float,
          "loop_distance_m": float}


def read_truth(path):
    with inputs.reading(path):
        rows = np.loadtxt(path, ndmin=2)[:, :8]
    x, y, z, w = rows[:, 4:8].T
    forward = np.stack([2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)], axis=1)
    return rows[:, 0], rows[:, 1:4], forward


def revisits(times, positions, forward, options):
    """Per frame whether an earlier place is revisited."""
    again = np.zeros(len(times), bool)
    cosine = np.cos(np.radians(options.angle))
    for i in range(len(times)):
        end = np.searchsorted(times, times[i] - options.gap)
        near = np.linalg.norm(positions[:end] - positions[i], axis=1) < options.radius
        again[i] = np.any(near & (forward[:end] @ forward[i] > cosine))
    groups = []
    for i in np.flatnonzero(again):
        if groups and times[i] - times[groups[-1][1]] < options.gap:
            groups[-1][1] = i
        else:
            groups.append([i, i])
    return [(times[a], times[b]) for a, b in groups if times[b] - times[a] >= options.least]


def connected(revisit, edges, times, positions, options):
    """Whether the map ties a revisit to the earlier visit."""
    begin, end = revisit[0], revisit[1] + options.gap
    for later, earlier, shared in edges:
        if begin <= later <= end and later - earlier >= options.gap and shared >= 15:
            a, b = (int(np.argmin(abs(times - t))) for t in (later, earlier))
            if np.linalg.norm(positions[a] - positions[b]) < 2 * options.radius:
                return True
    return False


class Limits:
    """The options' defaults, for callers that have none."""

    radius, angle, gap, least, error = 4.0, 30.0, 10.0, 3.0, 0.5


def recall_of(run, options=Limits):
    """Loops closed and true, revisits and those the map ties, largest gap of a loop (m) of a run.
    InputError: the folder has no ground truth or is incomplete."""
    run = pathlib.Path(run)
    times, positions, forward = read_truth(run / "ground_truth.tum")
    rows = inputs.read_table(run / "frames.csv", FRAMES)
    with inputs.reading(run / "graph.csv"):
        edges = np.loadtxt(run / "graph.csv", delimiter=",", skiprows=1, ndmin=2)[:, :3]
    time_of = {row["index"]: row["timestamp"] for row in rows}
    exist = revisits(times, positions, forward, options)
    closed, true, gap = [], 0, 0.0
    for row in rows:
        if not row["loop"]:
            continue
        closed.append(row["timestamp"])
        gap = max(gap, row["loop_gap_m"])
        if row["loop_frame"] not in time_of:
            continue
        a = int(np.argmin(abs(times - closed[-1])))
        b = int(np.argmin(abs(times - time_of[row["loop_frame"]])))
        error = abs(np.linalg.norm(positions[a] - positions[b]) - row["loop_distance_m"])
        true += bool(error <= options.error)
    joined = sum(connected(revisit, edges, times, positions, options) for revisit in exist)
    return {"loops_closed": len(closed), "loops_true": true, "revisits": len(exist),
            "revisits_joined": joined, "loop_gap_m": gap}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", nargs="+", type=pathlib.Path, help="output folder of a run")
    parser.add_argument("--radius", type=float, default=4.0, help="m, between the cameras of a revisit (default 4)")
    parser.add_argument("--angle", type=float, default=30.0, help="degrees (default 30)")
    parser.add_argument("--gap", type=float, default=10.0, help="s (default 10)")
    parser.add_argument("--least", type=float, default=3.0, help="s (default 3)")
    parser.add_argument("--error", type=float, default=0.5, help="m (default 0.5)")
    options = parser.parse_args()
    print("| run | loops closed | true | revisits | connected | largest gap [m] |")
    print("| --- | --- | --- | --- | --- | --- |")
    totals = np.zeros(4, int)
    for run in options.run:
        found = recall_of(run, options)
        counts = [found[key] for key in ("loops_closed", "loops_true", "revisits", "revisits_joined")]
        print(f"| {run.name} | {' | '.join(map(str, counts))} | {found['loop_gap_m']:.2f} |")
        totals += counts
    print(f"| all | {totals[0]} | {totals[1]} | {totals[2]} | {totals[3]} | |")
    return 0


if __name__ == "__main__":
    inputs.run(main)
