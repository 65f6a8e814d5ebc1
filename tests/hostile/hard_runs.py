#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What a camera does to a run when it fails: one row per fault, on a sequence in KITTI's layout with
ground truth (at least 50 frames).

    hard_runs.py BIN_DIR SEQUENCE [--python BUILD_DIR/python] [FAULT ...]

For every fault: exit status, tracked frames, the messages, the frame after the fault from which it
tracks again, largest position error. --python runs ten systems in one process, with the Python package
of a build. Needs Pillow and NumPy.
"""
import argparse
import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading

import numpy as np
from PIL import Image

FIRST, COUNT = 20, 10  # frames of a passing fault


class Sequence:
    """Frames as (left, right, time) and poses, of files that are linked until they are changed."""

    def __init__(self, folder):
        self.folder = folder
        names = sorted(os.listdir(os.path.join(folder, "image_0")))
        with open(os.path.join(folder, "times.txt"), encoding="ascii") as file:
            times = [float(line) for line in file.read().split()]
        with open(os.path.join(folder, "poses.txt"), encoding="ascii") as file:
            self.poses = file.read().splitlines()
        self.frames = [[os.path.join(folder, "image_0", n), os.path.join(folder, "image_1", n), t]
                       for n, t in zip(names, times)]
        self.step = times[1] - times[0]

    def write(self, folder):
        for camera in (0, 1):
            images = os.path.join(folder, f"image_{camera}")
            os.makedirs(images)
            for i, frame in enumerate(self.frames):
                target = os.path.join(images, f"{i:06d}.png")
                if isinstance(frame[camera], str):
                    os.symlink(os.path.abspath(frame[camera]), target)
                else:
                    Image.fromarray(frame[camera]).save(target, compress_level=1)
        shutil.copy(os.path.join(self.folder, "calib.txt"), folder)
        with open(os.path.join(folder, "times.txt"), "w", encoding="ascii") as file:
            file.writelines(f"{frame[2]:.6f}\n" for frame in self.frames)
        with open(os.path.join(folder, "poses.txt"), "w", encoding="ascii") as file:
            file.writelines(pose + "\n" for pose in self.poses)

    def take(self, order):
        """Other frames in another order, at the pace of the first."""
        self.frames = [[*self.frames[k][:2], self.step * i] for i, k in enumerate(order)]
        self.poses = [self.poses[k] for k in order]


def load(path):
    return np.asarray(Image.open(path).convert("L"))


def exposed(path, factor):
    return np.clip(load(path).astype(float) * factor, 0, 255).astype(np.uint8)


def change(camera, function):
    def apply(s):
        for frame in s.frames[FIRST:FIRST + COUNT]:
            for c in camera:
                frame[c] = function(frame[c])
    return apply


def late(s):
    for i in range(len(s.frames) - 1, 0, -1):
        s.frames[i][1] = s.frames[i - 1][1]


def dead(s):
    for frame in s.frames[FIRST:]:
        frame[1] = load(frame[1]) * 0


def upper_half(path):
    image = load(path).copy()
    image[image.shape[0] // 2:] = 0
    return image


def swapped(s):
    for frame in s.frames:
        frame[0], frame[1] = frame[1], frame[0]


def frozen(s):
    for frame in s.frames[FIRST:FIRST + COUNT]:
        frame[1] = s.frames[FIRST - 1][1]


def still(s):
    s.take([*range(FIRST), *[FIRST] * round(60 / s.step), *range(FIRST + 1, len(s.frames))])


def twice(s):
    order = [k // 2 for k in range(2 * len(s.frames))]
    s.frames = [[*s.frames[k][:2], s.frames[k][2] + (i % 2) * s.step / 2]
                for i, k in enumerate(order)]
    s.poses = [s.poses[k] for k in order]


def missing(s):
    gap = min(30, len(s.frames) - FIRST - 15)
    kept = [*range(FIRST), *range(FIRST + gap, len(s.frames))]
    s.frames = [s.frames[k] for k in kept]
    s.poses = [s.poses[k] for k in kept]


# Name: what is done, and after which frame it is over (None: it stays).
FAULTS = {
    "nothing": (lambda s: None, None),
    "right camera black for 10 frames": (change([1], lambda p: load(p) * 0), FIRST + COUNT),
    "right camera grey for 10 frames": (change([1], lambda p: load(p) * 0 + 128), FIRST + COUNT),
    "right camera black for good": (dead, None),
    "left camera black for 10 frames": (change([0], lambda p: load(p) * 0), FIRST + COUNT),
    "lower half of the right image black for 10 frames": (change([1], upper_half), FIRST + COUNT),
    "right camera frozen for 10 frames": (frozen, FIRST + COUNT),
    "both black for 10 frames": (change([0, 1], lambda p: load(p) * 0), FIRST + COUNT),
    "exposure x 0.3 for 10 frames": (change([0, 1], lambda p: exposed(p, 0.3)), FIRST + COUNT),
    "exposure x 3 for 10 frames": (change([0, 1], lambda p: exposed(p, 3)), FIRST + COUNT),
    "right exposure x 0.3 for 10 frames": (change([1], lambda p: exposed(p, 0.3)), FIRST + COUNT),
    "right image one frame late": (late, None),
    "left and right swapped": (swapped, None),
    "30 frames missing": (missing, FIRST),
    "standing still for a minute": (still, None),
    "every frame twice": (twice, None),
    "realtime with half a core": (lambda s: None, None),
}


def half_a_core():
    """One processor, and a busy neighbour on it."""
    core = min(os.sched_getaffinity(0))
    neighbour = subprocess.Popen([sys.executable, "-c", "while True: pass"],
                                 preexec_fn=lambda: os.sched_setaffinity(0, {core}))
    return neighbour, lambda: os.sched_setaffinity(0, {core})


def row(name, programs, sequence, folder):
    s = Sequence(sequence)
    fault, over = FAULTS[name]
    fault(s)
    place, output = os.path.join(folder, "sequence"), os.path.join(folder, "out")
    s.write(place)
    neighbour, before, schedule = None, None, "pipelined"
    if name.startswith("realtime"):
        neighbour, before = half_a_core()
        schedule = "realtime"
    result = subprocess.run([os.path.join(programs, "run_stereo_kitti"), place, "--output", output,
                             "--quiet", "--schedule", schedule], stderr=subprocess.PIPE, text=True,
                            check=False, preexec_fn=before)
    if neighbour:
        neighbour.send_signal(signal.SIGKILL)
        neighbour.wait()
    if not os.path.exists(os.path.join(output, "summary.json")):
        return f"| {name} | {result.returncode} | - | {result.stderr.strip()[-200:]} | - | - |"
    with open(os.path.join(output, "summary.json"), encoding="utf-8") as file:
        summary = json.load(file)
    with open(os.path.join(output, "frames.csv"), encoding="utf-8") as file:
        frames = list(csv.DictReader(file))
    lost = [f for f in frames if f["status"] == "lost"]
    reasons = [re.sub(r"\d+", "N", f["reason"]) for f in lost if f["reason"]]
    told = [f"{r} ({reasons.count(r)} frames)" for r in sorted(set(reasons))] + summary["warnings"]
    again = "-"
    if over is not None:
        tracked = [i for i in range(over, len(frames)) if frames[i]["status"] != "lost"]
        again = f"{tracked[0] - over}" if tracked else "never"
    error = summary.get("ate_se3_max_m")
    return (f"| {name} | {result.returncode} | {summary['frames_tracked']} of {summary['frames']}, "
            f"{summary['frames_connected']} connected, {summary['submaps']} sub-maps | "
            f"{'; '.join(told) or '-'} | {again} | {'-' if error is None else f'{error:.2f}'} |")


def ten_systems(sequence, module):
    """Ten systems side by side: whether all give the trajectory of one alone."""
    sys.path.insert(0, module)
    import kys_slam

    def run(results, k):
        frames = kys_slam.open_sequence(sequence)
        slam = kys_slam.System(frames.camera, kys_slam.Settings(), "pipelined")
        for frame in frames:
            slam.feed_frame(frame)
        slam.finish()
        results[k] = slam.trajectory().poses.tobytes()
    results = {}
    run(results, "alone")
    threads = [threading.Thread(target=run, args=(results, k)) for k in range(10)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    same = sum(results.get(k) == results["alone"] for k in range(10))
    return f"| ten systems in one process | - | {same} of 10 give the bytes of one alone | - | - | - |"


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bin")
    parser.add_argument("sequence")
    parser.add_argument("faults", nargs="*", help="parts of their names (default: all)")
    parser.add_argument("--python", help="folder of the built Python package")
    a = parser.parse_args()
    print("| fault | exit status | tracked | messages | tracks again after | largest error, m |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name in FAULTS:
        if a.faults and not any(word in name for word in a.faults):
            continue
        with tempfile.TemporaryDirectory(prefix="kys_hard_") as folder:
            print(row(name, a.bin, a.sequence, folder), flush=True)
    if a.python:
        print(ten_systems(a.sequence, a.python), flush=True)


if __name__ == "__main__":
    main()
