#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Sequences for evaluate_integrity.py, made of a recording in KITTI's layout by image operations.

    make_integrity_kinds.py bonnet CLIP OUT --percent 50
    make_integrity_kinds.py nod|far|small CLIP OUT

bonnet  a textured surface at 60 px of disparity covers the lowest rows: the own vehicle
nod     the first pair, seen by cameras that turn about their common x axis, 3 degrees up and down in 40
        frames: rotation without translation. The baseline is on that axis, so both images change by one
        homography, exactly
far     the first left image for both cameras, 0.2 px apart, which pans by 0.2 degrees per frame: everything
        is farther than the disparities tell; by its poses the camera goes 1 m per frame
small   the images reduced by three

Each frame gets noise of 2 grey levels of its own, apart from `small`. poses.txt has the true poses.
"""
import argparse
import os
import shutil
import sys

import numpy as np
from PIL import Image

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "..", "tools", "common"))
import inputs  # noqa: E402

FRAMES = 60  # of nod and far
NOISE = 2  # grey levels
NOD = np.radians(3)
PAN = np.radians(0.2)  # per frame
EDGE = 48  # px that nod and far lose on each side: they turn into view


def names_of(clip):
    folder = os.path.join(clip, "image_0")
    with inputs.reading(folder):
        names = sorted(n for n in os.listdir(folder) if n.endswith(".png"))
    if not names:
        inputs.fail(f"{folder}: no images")
    return names


def load(clip, camera, name, shape=None):
    """Grey values (height, width); `shape`: the one that the image must have."""
    file = os.path.join(clip, f"image_{camera}", name)
    with inputs.reading(file), Image.open(file) as image:
        grey = np.asarray(image.convert("L"), float)
    if min(grey.shape) <= 2 * EDGE or shape not in (None, grey.shape):
        inputs.fail(f"{file}: {grey.shape[1]}x{grey.shape[0]} px, "
                    + (f"not {shape[1]}x{shape[0]}" if shape else f"at least {2 * EDGE + 1} are needed"))
    return grey


def calibration_of(clip):
    """P0, P1 (3, 4)."""
    file = os.path.join(clip, "calib.txt")
    with inputs.reading(file), open(file, encoding="utf-8") as lines:
        rows = dict(line.split(":", 1) for line in lines if ":" in line)
        cameras = [np.array(rows[key].split(), float).reshape(3, 4) for key in ("P0", "P1")]
    if not (np.isfinite(cameras).all() and all(P[0, 0] > 0 and P[1, 1] > 0 for P in cameras)):
        inputs.fail(f"{file}: not the projections of two cameras")
    return cameras


def save(out, camera, name, image):
    Image.fromarray(np.clip(np.rint(image), 0, 255).astype(np.uint8)).save(
        os.path.join(out, f"image_{camera}", name))


def write_texts(out, cameras, poses=None):
    with open(os.path.join(out, "calib.txt"), "w", encoding="utf-8") as file:
        for k, P in enumerate(cameras):
            file.write(f"P{k}: " + " ".join(f"{v:.12e}" for v in P.ravel()) + "\n")
    if poses is None:
        return
    np.savetxt(os.path.join(out, "poses.txt"), [p.ravel() for p in poses], fmt="%.9e")
    np.savetxt(os.path.join(out, "times.txt"), 0.1 * np.arange(len(poses)), fmt="%.6f")


def copy_texts(clip, out):
    for name in ("poses.txt", "times.txt"):
        shutil.copy(os.path.join(clip, name), out)


def bonnet(clip, out, percent):
    names = names_of(clip)
    height, width = load(clip, 0, names[0]).shape
    rng = np.random.default_rng(5)
    coarse = rng.integers(0, 255, (height // 6 + 2, (width + 200) // 6 + 2)).astype(np.uint8)
    surface = np.asarray(Image.fromarray(coarse).resize((width + 200, height), Image.BICUBIC), float)
    top = int(height * (1 - percent / 100))
    for name in names:
        for camera, shift in ((0, 0), (1, 60)):
            image = load(clip, camera, name, (height, width))
            image[top:] = 0.6 * surface[top:, shift:shift + width] + 40
            image[top:] += rng.normal(0, NOISE, image[top:].shape)
            save(out, camera, name, image)
    write_texts(out, calibration_of(clip))
    copy_texts(clip, out)


def turned(image, K, R, shift=0):
    """What a camera turned by R (axes of the turned camera in those of the other) sees, bicubic."""
    H = K @ R @ np.linalg.inv(K)  # pixel of the turned camera -> pixel of the other
    H = np.array([[1, 0, shift], [0, 1, 0], [0, 0, 1]]) @ H
    H = (H / H[2, 2]).ravel()[:8]
    picture = Image.fromarray(image.astype(np.float32))  # Pillow's centres of pixels are at 0.5
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    H = half @ np.append(H, 1).reshape(3, 3) @ np.linalg.inv(half)
    return np.asarray(picture.transform(picture.size, Image.PERSPECTIVE, (H / H[2, 2]).ravel()[:8], Image.BICUBIC))


def turning(clip, out, sources, rotations, steps, shift):
    """Frames from one pair: `sources` the camera whose first image each camera turns."""
    name = names_of(clip)[0]
    cameras = calibration_of(clip)
    K = cameras[0][:, :3]
    first = load(clip, 0, name)
    images = [load(clip, source, name, first.shape) for source in sources]
    rng = np.random.default_rng(5)
    for k, R in enumerate(rotations):
        for camera, image in enumerate(images):
            seen = turned(image, K, R, shift * camera)[EDGE:-EDGE, EDGE:-EDGE]
            save(out, camera, f"{k:06d}.png", seen + rng.normal(0, NOISE, seen.shape))
    for P in cameras:
        P[:, :3] = [[1, 0, -EDGE], [0, 1, -EDGE], [0, 0, 1]] @ P[:, :3]
    poses = [np.column_stack([R, [0, 0, k * steps]]) for k, R in enumerate(rotations)]
    write_texts(out, cameras, poses)


def nod(clip, out):
    angles = NOD * np.sin(2 * np.pi * np.arange(FRAMES) / 40)
    turning(clip, out, (0, 1), [np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
                                for a in angles], 0, 0)


def far(clip, out):
    """Pans there and back, so that what leaves the image comes again."""
    angles = PAN * (9 - abs(np.arange(FRAMES) % 36 - 18))
    turning(clip, out, (0, 0), [np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
                                for a in angles], 1, 0.2)


def small(clip, out, factor=3):
    for name in names_of(clip):
        for camera in (0, 1):
            image = load(clip, camera, name)
            height, width = (n // factor for n in image.shape)
            blocks = image[:height * factor, :width * factor].reshape(height, factor, width, factor)
            save(out, camera, name, blocks.mean((1, 3)))
    cameras = calibration_of(clip)
    for P in cameras:
        # The centre of the first pixel lies at (factor - 1) / 2 of the old ones.
        P[:2, 2] -= (factor - 1) / 2
        P[:2] /= factor
    write_texts(out, cameras)
    copy_texts(clip, out)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=("bonnet", "nod", "far", "small"))
    parser.add_argument("clip", metavar="CLIP")
    parser.add_argument("out", metavar="OUT", help="folder that does not exist")
    parser.add_argument("--percent", type=float, default=50, help="rows that the bonnet covers (default 50)")
    arguments = parser.parse_args()
    if not 0 < arguments.percent < 100:
        inputs.fail("--percent must be above 0 and below 100")
    if os.path.exists(arguments.out):
        inputs.fail(f"{arguments.out}: exists")
    names_of(arguments.clip)
    for camera in (0, 1):
        os.makedirs(os.path.join(arguments.out, f"image_{camera}"))
    if arguments.kind == "bonnet":
        bonnet(arguments.clip, arguments.out, arguments.percent)
    else:
        {"nod": nod, "far": far, "small": small}[arguments.kind](arguments.clip, arguments.out)


if __name__ == "__main__":
    inputs.run(main)
