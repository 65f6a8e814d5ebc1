#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A long run in one place: does a frame cost more, and does memory grow, when the place is known?

    long_run.py --output DIR [--minutes 60] [--bin build/release/bin] [--seed 1]

A stereo camera goes laps of 25 s in a room of 8 by 6 m, no two the same, at 20 Hz; corners are simulated
(simulate_features). It prints, and writes as DIR/long_run.md, a row per tenth of the time: time of tracking
(ms: median, 95 % of the frames, mean), keyframes made, resident memory (MB), tracked landmarks.
"""
import argparse
import csv
import math
import os
import statistics

from runs import call, find_program, read_json, remove, write_text
from inputs import run  # runs knows where it is

RATE = 20  # Hz
LAP = 25  # s


def body(seconds):
    """Position (m) and heading (rad) of the camera's body at a time."""
    phase = 2 * math.pi * seconds / LAP

    def place(p):
        return (3 * math.cos(p) + 0.5 * math.sin(p / 7.3 + 1), 2 * math.sin(p) + 0.4 * math.cos(p / 5.1))

    (x, y), (ahead_x, ahead_y) = place(phase), place(phase + 1e-4)
    heading = math.atan2(ahead_y - y, ahead_x - x) + 0.25 * math.sin(phase / 2.3)
    return (x, y, 1.2 + 0.3 * math.sin(phase / 3.7)), heading


def path_text(minutes):
    """A trajectory in the format of TUM: the body turns about the vertical."""
    rows = []
    for k in range(round(minutes * 60 * RATE)):
        (x, y, z), heading = body(k / RATE)
        turn = f"0 0 {math.sin(heading / 2):.8f} {math.cos(heading / 2):.8f}"
        rows.append(f"{1000 + k / RATE:.6f} {x:.6f} {y:.6f} {z:.6f} {turn}\n")
    return "".join(rows)


def table(frames, parts=10):
    """Rows of frames.csv -> Markdown."""
    lines = ["| frames | tracking, ms: median | 95 % | mean | keyframes made | resident, MB | landmarks tracked |",
             "| --- | --- | --- | --- | --- | --- | --- |"]
    for part in range(parts):
        rows = frames[part * len(frames) // parts:(part + 1) * len(frames) // parts]
        times = sorted(float(row["ms_total"]) for row in rows)
        lines.append(f"| {rows[0]['index']}-{rows[-1]['index']} | {statistics.median(times):.2f} "
                     f"| {times[len(times) * 95 // 100]:.2f} | {statistics.mean(times):.2f} "
                     f"| {sum(int(row['keyframe']) for row in rows)} | {rows[-1]['resident_mb']} "
                     f"| {statistics.mean(int(row['matches']) for row in rows):.0f} |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", required=True)
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--bin", default="build/release/bin")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    if not 0.5 <= arguments.minutes <= 600:
        parser.error("--minutes is from 0.5 to 600")
    os.makedirs(arguments.output, exist_ok=True)
    trajectory, features, folder = (os.path.join(arguments.output, name)
                                    for name in ("path.tum.txt", "room.features", "run"))
    write_text(trajectory, path_text(arguments.minutes))
    print("simulating the features", flush=True)
    call([find_program(arguments.bin, "simulate_features"), trajectory, "--camera", "euroc", "--features", "800",
          "--seed", str(arguments.seed), "--output", features, "--quiet"])
    print("tracking", flush=True)
    call([find_program(arguments.bin, "run_stereo_euroc"), features, "--schedule", "pipelined", "--quiet",
          "--overwrite", "--output", folder])
    remove(features)  # 80 MB per minute
    with open(os.path.join(folder, "frames.csv"), encoding="utf-8", newline="") as file:
        text = table(list(csv.DictReader(file)))
    summary = read_json(os.path.join(folder, "summary.json"))
    text += (f"\n{summary['frames_connected']} of {summary['frames']} frames connected, "
             f"{summary['keyframes']} keyframes, {summary['landmarks']} landmarks, path length "
             f"{summary['path_length_m']:.0f} m, ATE {summary['ate_se3_rmse_m']:.4f} m, "
             f"{summary['process']['cpu_ms_per_frame']:.2f} ms of processor time per frame, "
             f"{summary['peak_memory_mb']:.0f} MB at most\n")
    write_text(os.path.join(arguments.output, "long_run.md"), text)
    print(text, end="")
    return 0


if __name__ == "__main__":
    run(main)
