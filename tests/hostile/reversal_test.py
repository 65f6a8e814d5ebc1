#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Cameras against the motion model: one that goes forward, at once backward and at once forward again
(the first 51 frames of KITTI 06 at half size), and one that gives every picture twice. Skipped without
the images or without Pillow.

    reversal_test.py BIN_DIR SHARED_DATA_DIR [CYCLES]

With CYCLES there and back so often in one run, by hand: the place has to stay one place.
"""
import csv
import json
import os
import subprocess
import sys
import tempfile

SKIPPED = 77
try:
    from PIL import Image
except ImportError:
    print("no Pillow")
    sys.exit(SKIPPED)


def there_back_and_there(count):
    return [*range(count), *range(count - 2, 0, -1), *range(count)]


def every_image_twice(count):
    return [k // 2 for k in range(2 * count)]


def halve(clip, folder, choose=there_back_and_there):
    """The clip at half size, its frames in the order chosen; how many."""
    order = None
    for camera in (0, 1):
        source = os.path.join(clip, f"image_{camera}")
        target = os.path.join(folder, f"image_{camera}")
        os.makedirs(target)
        names = sorted(os.listdir(source))
        order = choose(len(names))
        os.makedirs(os.path.join(folder, "pictures", str(camera)))
        for i, name in enumerate(names):
            image = Image.open(os.path.join(source, name)).convert("L")
            width, height = image.width // 2, image.height // 2
            image = image.crop((0, 0, 2 * width, 2 * height))
            image.resize((width, height), Image.LANCZOS).save(
                os.path.join(folder, "pictures", str(camera), f"{i}.png"), compress_level=1)
        for i, k in enumerate(order):
            os.symlink(f"../pictures/{camera}/{k}.png", os.path.join(target, f"{i:06d}.png"))
    with open(os.path.join(folder, "calib.txt"), "w", encoding="ascii") as file:
        for line in open(os.path.join(clip, "calib.txt"), encoding="ascii"):
            name, *values = line.split() or [""]
            if not name.startswith("P"):
                continue
            numbers = [float(v) / 2 for v in values[:8]] + [float(v) for v in values[8:]]
            numbers[2] -= 0.25  # centres of pixels
            numbers[6] -= 0.25
            file.write(name + " " + " ".join(map(repr, numbers)) + "\n")
    with open(os.path.join(folder, "times.txt"), "w", encoding="ascii") as file:
        file.writelines(f"{0.1 * i:.6f}\n" for i in range(len(order)))
    with open(os.path.join(clip, "poses.txt"), encoding="ascii") as file:
        poses = file.read().split("\n")
    with open(os.path.join(folder, "poses.txt"), "w", encoding="ascii") as file:
        file.writelines(poses[k] + "\n" for k in order)
    return len(order)


def cycles(count, programs, clip):
    """There and back `count` times: what is tracked and how many keyframes there are, in quarters."""
    with tempfile.TemporaryDirectory(prefix="kys_reversal_") as folder:
        halve(clip, folder, lambda n: [*list(range(n)), *list(range(n - 2, 0, -1))] * count)
        output = os.path.join(folder, "out")
        subprocess.run([os.path.join(programs, "run_stereo_kitti"), folder, "--output", output,
                        "--quiet"], check=True)
        with open(os.path.join(output, "summary.json"), encoding="utf-8") as file:
            s = json.load(file)
        with open(os.path.join(output, "frames.csv"), encoding="utf-8") as file:
            frames = list(csv.DictReader(file))
    made = [sum(f["keyframe"] == "1" for f in frames[k * len(frames) // 4:
                                                     (k + 1) * len(frames) // 4]) for k in range(4)]
    print(f"{count} cycles: {s['frames_tracked']} of {s['frames']} tracked, "
          f"{s['frames_connected']} connected, ATE {s['ate_se3_rmse_m']:.3f} m, largest error "
          f"{s['ate_se3_max_m']:.2f} m, {s['keyframes']} keyframes, made in each quarter {made}, "
          f"{s['loops_closed']} loops, {s['submaps']} sub-maps")
    return 0


def main():
    programs, shared, *count = sys.argv[1:]
    clip = os.path.join(shared, "kitti_06_clip")
    if not os.path.isdir(clip):
        print("no images")
        return SKIPPED
    if count:
        return cycles(int(count[0]), programs, clip)
    failed = 0
    for choose in (there_back_and_there, every_image_twice):
        with tempfile.TemporaryDirectory(prefix="kys_reversal_") as folder:
            frames = halve(clip, folder, choose)
            for schedule in ("pipelined", "sequential"):
                output = os.path.join(folder, schedule)
                subprocess.run([os.path.join(programs, "run_stereo_kitti"), folder, "--output",
                                output, "--schedule", schedule, "--quiet"], check=True)
                with open(os.path.join(output, "summary.json"), encoding="utf-8") as file:
                    summary = json.load(file)
                print(f"{choose.__name__}, {schedule}: {summary['frames_tracked']} of {frames} "
                      f"tracked, largest error {summary['ate_se3_max_m']:.2f} m")
                failed += summary["frames_tracked"] != frames or summary["ate_se3_max_m"] > 0.6
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
