#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""make_integrity_kinds on a pair of images of one dot: the dot is where the written poses and calibration
put it."""
import os
import subprocess
import sys
import tempfile

try:
    import numpy as np
    from PIL import Image
except ImportError:
    print("numpy or Pillow is missing")
    sys.exit(77)

HERE = os.path.dirname(os.path.abspath(__file__))
PROGRAM = os.path.join(HERE, "make_integrity_kinds.py")
WIDTH, HEIGHT, FOCAL, DOT = 360, 240, 400, np.array([190, 110])


def dot_at(u, v):
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return (20 + 200 * np.exp(-((x - u) ** 2 + (y - v) ** 2) / 32)).round().astype(np.uint8)


def write_clip(folder):
    """Three equal pairs; the dot has 12 px of disparity."""
    for camera in (0, 1):
        os.makedirs(f"{folder}/image_{camera}")
        for k in range(3):
            Image.fromarray(dot_at(DOT[0] - 12 * camera, DOT[1])).save(f"{folder}/image_{camera}/{k:06d}.png")
    with open(f"{folder}/calib.txt", "w", encoding="utf-8") as file:
        for camera in (0, 1):
            file.write(f"P{camera}: {FOCAL} 0 180 {-200 * camera} 0 {FOCAL} 120 0 0 0 1 0\n")
    np.savetxt(f"{folder}/poses.txt", np.tile(np.eye(4)[:3].ravel(), (3, 1)))
    np.savetxt(f"{folder}/times.txt", 0.1 * np.arange(3))


def make(kind, clip, out, *more):
    return subprocess.run([sys.executable, PROGRAM, kind, clip, out, *more], capture_output=True, text=True,
                          check=False)


def read(out, camera, k):
    return np.asarray(Image.open(f"{out}/image_{camera}/{k:06d}.png"), float)


def centre(out, camera, k):
    """Of the dot, px."""
    weight = np.maximum(read(out, camera, k) - 40, 0)
    y, x = np.mgrid[:weight.shape[0], :weight.shape[1]]
    return np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()


def matrices(out):
    with open(f"{out}/calib.txt", encoding="utf-8") as file:
        cameras = [np.array(line.split()[1:], float).reshape(3, 4) for line in file]
    return cameras, np.loadtxt(f"{out}/poses.txt").reshape(-1, 3, 4)


def check_turning(out, disparity, step):
    """The dot's direction, turned by the poses, is where the images have it. `step`: m per frame."""
    (P0, P1), poses = matrices(out)
    ray = [(DOT[0] - 180) / FOCAL, (DOT[1] - 120) / FOCAL, 1]  # of the first image
    seen = []
    for k in (0, 5, 10, 20, 33):
        p = P0[:, :3] @ poses[k][:, :3].T @ ray
        seen.append(p[:2] / p[2])
        assert np.linalg.norm(centre(out, 0, k) - seen[-1]) < 0.1, (k, centre(out, 0, k), seen[-1])
        right = centre(out, 1, k)
        assert abs(seen[-1][0] - right[0] - disparity) < 0.1 and abs(seen[-1][1] - right[1]) < 0.1, k
        assert np.allclose(poses[k][:, 3], [0, 0, k * step])
    assert np.ptp(np.array(seen), axis=0).max() > 10  # px
    assert np.allclose(P1[:, :3], P0[:, :3]) and P1[0, 3] == -200


def main():
    with tempfile.TemporaryDirectory() as folder:
        clip = f"{folder}/clip"
        write_clip(clip)
        for kind in ("nod", "far", "small"):
            done = make(kind, clip, f"{folder}/{kind}")
            assert done.returncode == 0, done.stderr
        check_turning(f"{folder}/nod", 12, 0)
        check_turning(f"{folder}/far", 0.2, 1)
        (P0, P1), _ = matrices(f"{folder}/small")
        p = P0[:, :3] @ [(DOT[0] - 180) / FOCAL, (DOT[1] - 120) / FOCAL, 1]
        assert read(f"{folder}/small", 0, 1).shape == (HEIGHT // 3, WIDTH // 3)
        assert np.linalg.norm(centre(f"{folder}/small", 0, 1) - p[:2] / p[2]) < 0.1
        assert np.isclose(P1[0, 3] / P1[0, 0], -200 / FOCAL)  # the baseline stays
        done = make("bonnet", clip, f"{folder}/bonnet", "--percent", "50")
        assert done.returncode == 0, done.stderr
        left, right, next_left = (read(f"{folder}/bonnet", c, k) for c, k in ((0, 1), (1, 1), (0, 2)))
        assert (left[:120] == read(clip, 0, 1)[:120]).all()
        assert left[120:].std() > 10
        assert abs(left[120:, 60:] - right[120:, :-60]).mean() < 4  # 60 px of disparity, noise of 2
        assert abs(left[120:] - next_left[120:]).mean() < 4  # keeps its place
        assert make("nod", clip, f"{folder}/nod").returncode == 2  # exists
        done = make("nod", f"{folder}/nothing", f"{folder}/new")
        assert done.returncode == 2 and "nothing" in done.stderr, done.stderr
        assert make("bonnet", clip, f"{folder}/new", "--percent", "nan").returncode == 2
        assert not os.path.exists(f"{folder}/new")
        Image.fromarray(dot_at(*DOT)[:-1]).save(f"{clip}/image_1/000000.png")
        for kind in ("nod", "bonnet"):
            done = make(kind, clip, f"{folder}/{kind}_uneven")
            assert done.returncode == 2 and "360x239" in done.stderr, done.stderr
    print("passed")


main()
