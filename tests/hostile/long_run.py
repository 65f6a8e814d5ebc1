#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Hours of driving in one run: memory, time per frame and threads over time.

    long_run.py BIN_DIR TRAJECTORY WORK_DIR [--hours 2] [--features 600]

TRAJECTORY (KITTI poses, 10 Hz) comes back to where it began, like KITTI odometry 07. Some laps of it
are simulated as features with traffic, priors among them, and driven again and again; at every
kidnapping the camera is put elsewhere on the lap. Runs in mode stock (priors off) and kys (on), prints
a table and writes WORK_DIR/long_run.png. A run that is there already is not made again.
"""
import argparse
import csv
import json
import os
import struct
import subprocess
import threading
import time
import zlib

import numpy as np

KIDNAPPINGS = 5
LAPS = 3  # simulated
HEADER, POSE = 144, 64  # bytes in a feature file


def read_poses(path):
    rows = np.loadtxt(path).reshape(-1, 3, 4)
    poses = np.zeros((len(rows), 4, 4))
    poses[:, :3], poses[:, 3, 3] = rows, 1
    return poses


def close_lap(poses):
    """The same lap with the gap between its end and its beginning spread over all of it (heading and
    position, in the plane)."""
    gap = np.linalg.inv(poses[-1]) @ poses[0]
    yaw = np.arctan2(gap[0, 2], gap[0, 0])
    closed = []
    for i, pose in enumerate(poses):
        share = i / (len(poses) - 1)
        c, s = np.cos(share * yaw), np.sin(share * yaw)
        part = np.array([[c, 0, s, share * gap[0, 3]], [0, 1, 0, 0], [-s, 0, c, share * gap[2, 3]],
                         [0, 0, 0, 1]])
        closed.append(pose @ part)
    return np.array(closed)


def simulate(programs, lap, features, folder):
    """The feature file of LAPS laps: noise, traffic and priors differ from lap to lap."""
    poses, path = (os.path.join(folder, name) for name in ("laps.txt", "laps.features"))
    with open(poses, "w", encoding="ascii") as file:
        for pose in np.concatenate([lap] * LAPS):
            file.write(" ".join(f"{v:.9e}" for v in pose[:3].ravel()) + "\n")
    if not os.path.exists(path):
        subprocess.run([os.path.join(programs, "simulate_features"), poses, "--output", path,
                        "--features", str(features), "--width", "620", "--traffic", "light",
                        "--perception", "estimated", "--quiet"], check=True)
    return path


def repeat(laps, lap_length, frames, path):
    """A feature file of so many frames out of those of `laps`; the frames at which it jumps. The format
    is that of tools/simulator/features/README.md, version 2."""
    with open(laps, "rb") as file:
        data = file.read()
    count, = struct.unpack_from("<Q", data, 80)
    truth, = struct.unpack_from("<Q", data, 124)
    at = HEADER + POSE * count + 4 + truth
    blocks = []
    for _ in range(count):
        size, = struct.unpack_from("<I", data, at + 4)
        blocks.append((at, at + 12 + size))
        at += 12 + size
    jumps = [(k + 1) * frames // (KIDNAPPINGS + 1) for k in range(KIDNAPPINGS)]
    order, now = [], -1
    for i in range(frames):
        now = (now + (lap_length * 2 // 5 if i in jumps else 1)) % count
        order.append(now)
    head = bytearray(data[:HEADER])
    struct.pack_into("<Q", head, 80, frames)
    struct.pack_into("<I", head, HEADER - 4, zlib.crc32(head[:-4]))
    poses = b"".join(struct.pack("<d", 0.1 * i) + data[HEADER + POSE * k + 8:HEADER + POSE * (k + 1)]
                     for i, k in enumerate(order))
    begin = HEADER + POSE * count + 4
    with open(path, "wb") as file:
        file.write(head + poses + struct.pack("<I", zlib.crc32(poses)) + data[begin:begin + truth])
        for k in order:
            file.write(data[slice(*blocks[k])])
    return jumps


class Watch(threading.Thread):
    """Resident memory and threads of a process, once a second."""

    def __init__(self, process):
        super().__init__()
        self.process, self.rows, self.began = process, [], time.monotonic()

    def run(self):
        while self.process.poll() is None:
            try:
                with open(f"/proc/{self.process.pid}/status", encoding="ascii") as file:
                    fields = dict(line.split(":", 1) for line in file)
                self.rows.append((time.monotonic() - self.began,
                                  int(fields["VmRSS"].split()[0]) / 1024,
                                  int(fields["Threads"])))
            except (OSError, KeyError):
                pass
            time.sleep(1)


def run(programs, features, mode, output):
    process = subprocess.Popen([os.path.join(programs, "run_stereo_kitti"), features, "--mode", mode,
                                "--output", output, "--overwrite", "--quiet"])
    watch = Watch(process)
    watch.start()
    watch.join()
    with open(os.path.join(output, "watch.json"), "w", encoding="ascii") as file:
        json.dump({"status": process.returncode, "watch": watch.rows}, file)
    return load(output)


def load(output):
    """What a run left: also one of an earlier call."""
    with open(os.path.join(output, "frames.csv"), encoding="utf-8") as file:
        frames = list(csv.DictReader(file))
    with open(os.path.join(output, "summary.json"), encoding="utf-8") as file:
        summary = json.load(file)
    with open(os.path.join(output, "watch.json"), encoding="ascii") as file:
        return {"frames": frames, "summary": summary, **json.load(file)}


def column(result, name):
    return np.array([float(f[name]) for f in result["frames"]])


def recovery(result, jump):
    """Frames from a kidnapping to the next frame tracked in the common frame."""
    for i, frame in enumerate(result["frames"][jump:]):
        if i > 0 and frame["status"] != "lost":
            return i
    return None


def tell(mode, result, jumps):
    s, memory = result["summary"], column(result, "resident_mb")
    total = column(result, "ms_total")
    count = len(memory)
    print(f"\n{mode}: status {result['status']}, {s['frames_tracked']} of {s['frames']} tracked, "
          f"{s['frames_connected']} connected, ATE {s.get('ate_se3_rmse_m', float('nan')):.3f} m, "
          f"{s['keyframes']} keyframes, {s['landmarks']} landmarks, {s['loops_closed']} loops, "
          f"{s['submaps_merged']} merges, {s['relocalisations']} relocalisations")
    print("| part of the run | memory MB, at its end | ms per frame, median | p95 | keyframes made |")
    print("| --- | --- | --- | --- | --- |")
    made = column(result, "keyframe")
    for k in range(8):
        part = slice(k * count // 8, (k + 1) * count // 8)
        print(f"| {k + 1}/8 | {memory[part][-1]:.0f} | {np.median(total[part]):.2f} | "
              f"{np.percentile(total[part], 95):.2f} | {made[part].sum():.0f} |")
    threads = sorted({t for _, _, t in result["watch"]})
    print(f"threads: {threads}; frames to recover from each kidnapping: "
          f"{[recovery(result, j) for j in jumps]}")


def plot(results, path):
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot
    figure, axes = pyplot.subplots(4, 1, figsize=(9, 11))
    for mode, result in results.items():
        memory, total = column(result, "resident_mb"), column(result, "ms_total")
        minutes = column(result, "timestamp") / 60
        window = 600
        smooth = [np.median(total[i:i + window]) for i in range(0, len(total), window)]
        axes[0].plot(minutes, memory, label=mode)
        axes[1].plot(minutes, np.cumsum(column(result, "keyframe")), label=mode)
        axes[2].plot(minutes[::window], smooth, label=mode)
        seconds = [r[0] for r in result["watch"]]
        axes[3].step(seconds, [r[2] for r in result["watch"]], label=mode)
    for axis, text in zip(axes, ("resident memory, MB", "keyframes made", "ms per frame, median of "
                                 "a minute", "threads")):
        axis.set_ylabel(text)
        axis.set_ylim(bottom=0)
        axis.grid(alpha=0.3)
        axis.legend()
    axes[2].set_xlabel("minutes of driving")
    axes[3].set_xlabel("s of the run")
    figure.tight_layout()
    figure.savefig(path, dpi=80)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bin")
    parser.add_argument("trajectory")
    parser.add_argument("work")
    parser.add_argument("--hours", type=float, default=2)
    parser.add_argument("--features", type=int, default=600)
    parser.add_argument("--modes", default="stock,kys")
    a = parser.parse_args()
    os.makedirs(a.work, exist_ok=True)
    lap = close_lap(read_poses(a.trajectory))
    laps = simulate(a.bin, lap, a.features, a.work)
    features = os.path.join(a.work, "drive.features")
    jumps = repeat(laps, len(lap), int(a.hours * 36000), features)
    results = {}
    for mode in a.modes.split(","):
        output = os.path.join(a.work, mode)
        done = os.path.exists(os.path.join(output, "watch.json"))
        results[mode] = load(output) if done else run(a.bin, features, mode, output)
        tell(mode, results[mode], jumps)
    plot(results, os.path.join(a.work, "long_run.png"))


if __name__ == "__main__":
    main()
