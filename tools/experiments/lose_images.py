#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A sequence as a camera records it that loses images: some are missing, others repeat the one before,
or they get their time stamps too late.

    lose_images.py SEQUENCE --output DIR [--priors PRIORS] [--missing SHARE] [--repeated SHARE] [--late SHARE]

SEQUENCE is in the layout of KITTI odometry with its own poses.txt, as simulate_sequence writes it. DIR
gets links to its images, numbered anew, with the time stamps and poses of what is left; DIR/priors the
same of the prior files PRIORS. A missing image takes its time stamp with it. A repeated one has its own,
and the pose of the image that it shows. The first four images are never lost: a map has to start.
Stamps are late by up to a share of the mean interval, each by another time.
"""
import argparse
import os
import pathlib
import random
import shutil
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import inputs  # noqa: E402

CAMERAS = ("image_0", "image_1")
KEPT = 4  # images at the start


def shown(count, missing, repeated, seed):
    """Per frame of the new sequence: the frame whose time it has, and the one whose image it shows."""
    generator = random.Random(seed)
    frames = []
    for i in range(count):
        luck = generator.random()
        if i >= KEPT and luck < missing:
            continue
        again = i >= KEPT and luck < missing + repeated
        frames.append((i, frames[-1][1] if again else i))
    return frames


def late_times(path, times, late, seed):
    """The time stamps with an even distribution of delays, to the microsecond."""
    with inputs.reading(path):
        values = [float(text) for text in times]
    if late == 0 or len(values) < 2:
        return times
    generator = random.Random(-1 - seed)
    longest = late * (values[-1] - values[0]) / (len(values) - 1)
    return [f"{value + generator.uniform(0, longest):.6f}" for value in values]


def lines_of(path, count):
    with inputs.reading(path), open(path, encoding="utf-8") as file:
        lines = file.read().splitlines()
    if len(lines) != count:
        inputs.fail(f"{path}: {len(lines)} lines for {count} images")
    return lines


def names_in(folder):
    """Files of a folder, in order."""
    with inputs.reading(folder):
        return sorted(e.name for e in os.scandir(folder) if e.is_file())


def link(source, target):
    os.symlink(os.path.abspath(source), target)


def lose(sequence, output, priors, seed, missing=0, repeated=0, late=0):
    """Writes the new sequence; returns its frames as shown() gives them."""
    images = names_in(os.path.join(sequence, CAMERAS[0]))
    if not images:
        inputs.fail(f"{sequence}/{CAMERAS[0]}: no images")
    if names_in(os.path.join(sequence, CAMERAS[1])) != images:
        inputs.fail(f"{sequence}: {CAMERAS[0]} and {CAMERAS[1]} have other images")
    times, poses = (lines_of(os.path.join(sequence, name), len(images)) for name in ("times.txt", "poses.txt"))
    times = late_times(os.path.join(sequence, "times.txt"), times, late, seed)
    frames = shown(len(images), missing, repeated, seed)
    for camera in CAMERAS:
        os.makedirs(os.path.join(output, camera))
    shutil.copy(os.path.join(sequence, "calib.txt"), output)
    for k, (_, image) in enumerate(frames):
        extension = os.path.splitext(images[image])[1]
        for camera in CAMERAS:
            link(os.path.join(sequence, camera, images[image]),
                 os.path.join(output, camera, f"{k:06d}{extension}"))
    for name, lines in (("times.txt", [times[i] for i, _ in frames]),
                        ("poses.txt", [poses[image] for _, image in frames])):
        pathlib.Path(output, name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    if priors:
        os.makedirs(os.path.join(output, "priors"))
        there = set(names_in(priors))
        for k, (_, image) in enumerate(frames):
            name = os.path.splitext(images[image])[0] + ".kysp"
            if name in there:
                link(os.path.join(priors, name), os.path.join(output, "priors", f"{k:06d}.kysp"))
    return frames


def share(text):
    value = float(text)
    if not 0 <= value <= 0.9:
        raise ValueError(text)
    return value


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequence")
    parser.add_argument("--output", required=True, metavar="DIR", help="must not exist, or be empty")
    parser.add_argument("--priors", help="folder of the sequence's prior files")
    parser.add_argument("--missing", type=share, default=0.0, metavar="SHARE", help="0..0.9 (default: 0)")
    parser.add_argument("--repeated", type=share, default=0.0, metavar="SHARE", help="0..0.9 (default: 0)")
    parser.add_argument("--late", type=share, default=0.0, metavar="SHARE", help="0..0.9 (default: 0)")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if options.missing + options.repeated > 0.9:
        parser.error("more than 0.9 of the images are lost")
    if os.path.isdir(options.output) and os.listdir(options.output):
        inputs.fail(f"{options.output}: is not empty")
    frames = lose(options.sequence, options.output, options.priors, options.seed, options.missing,
                  options.repeated, options.late)
    again = sum(i != image for i, image in frames)
    print(f"{len(frames)} frames, {again} with a repeated image, in {options.output}")
    return 0


if __name__ == "__main__":
    inputs.run(main)
