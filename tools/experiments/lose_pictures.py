#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A sequence as a camera records it that loses pictures: some are missing, others repeat the one before,
or they get their time stamps too late.

    lose_pictures.py SEQUENCE --output DIR [--priors PRIORS] [--missing SHARE] [--repeated SHARE] [--late SHARE]

SEQUENCE is in the layout of KITTI odometry with its own poses.txt, as simulate_sequence writes it. DIR
gets links to its pictures, numbered anew, with the time stamps and poses of what is left; DIR/priors the
same of the prior files PRIORS. A missing picture takes its time stamp with it. A repeated one has its own,
and the pose of the picture that it shows. The first four pictures are never lost: a map has to start.
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
KEPT = 4  # pictures at the start


def shown(count, missing, repeated, seed):
    """Per frame of the new sequence: the frame whose time it has, and the one whose picture it shows."""
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
        inputs.fail(f"{path}: {len(lines)} lines for {count} pictures")
    return lines


def names_in(folder):
    """Files of a folder, in order."""
    with inputs.reading(folder):
        return sorted(e.name for e in os.scandir(folder) if e.is_file())


def link(source, target):
    os.symlink(os.path.abspath(source), target)


def lose(sequence, output, priors, seed, missing=0, repeated=0, late=0):
    """Writes the new sequence; returns its frames as shown() gives them."""
    pictures = names_in(os.path.join(sequence, CAMERAS[0]))
    if not pictures:
        inputs.fail(f"{sequence}/{CAMERAS[0]}: no pictures")
    if names_in(os.path.join(sequence, CAMERAS[1])) != pictures:
        inputs.fail(f"{sequence}: {CAMERAS[0]} and {CAMERAS[1]} have other pictures")
    times, poses = (lines_of(os.path.join(sequence, name), len(pictures)) for name in ("times.txt", "poses.txt"))
    times = late_times(os.path.join(sequence, "times.txt"), times, late, seed)
    frames = shown(len(pictures), missing, repeated, seed)
    for camera in CAMERAS:
        os.makedirs(os.path.join(output, camera))
    shutil.copy(os.path.join(sequence, "calib.txt"), output)
    for k, (_, picture) in enumerate(frames):
        extension = os.path.splitext(pictures[picture])[1]
        for camera in CAMERAS:
            link(os.path.join(sequence, camera, pictures[picture]),
                 os.path.join(output, camera, f"{k:06d}{extension}"))
    for name, lines in (("times.txt", [times[i] for i, _ in frames]),
                        ("poses.txt", [poses[picture] for _, picture in frames])):
        pathlib.Path(output, name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    if priors:
        os.makedirs(os.path.join(output, "priors"))
        there = set(names_in(priors))
        for k, (_, picture) in enumerate(frames):
            name = os.path.splitext(pictures[picture])[0] + ".kysp"
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
        parser.error("more than 0.9 of the pictures are lost")
    if os.path.isdir(options.output) and os.listdir(options.output):
        inputs.fail(f"{options.output}: is not empty")
    frames = lose(options.sequence, options.output, options.priors, options.seed, options.missing,
                  options.repeated, options.late)
    again = sum(i != picture for i, picture in frames)
    print(f"{len(frames)} frames, {again} with a repeated picture, in {options.output}")
    return 0


if __name__ == "__main__":
    inputs.run(main)
