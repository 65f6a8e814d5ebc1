# SPDX-License-Identifier: BSD-3-Clause
"""A small simulated corridor, drawn and tracked: shows that the installation works."""

import numpy as np

import kys_slam

CAMERA = dict(width=320, height=240, fx=250.0, fy=250.0, cx=159.5, cy=119.5, baseline=0.2)


def _hash(a: np.ndarray, b: np.ndarray, salt: int) -> np.ndarray:
    """Values in [0, 1) of whole numbers."""
    with np.errstate(over="ignore"):
        h = (a.astype(np.int64) * 1000003 + b.astype(np.int64) * 7919 + salt).astype(np.uint64)
        h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (h >> np.uint64(40)).astype(np.float64) / 2**24


def _texture(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    value = np.full(s.shape, 128.0)
    for salt, size in enumerate((0.05, 0.1, 0.2, 0.4, 0.8)):
        value += 50 * (_hash(np.floor(s / size), np.floor(t / size), salt) - 0.5)
    return value


def picture(x: float, z: float) -> np.ndarray:
    """(240, 320) uint8: what a camera at (x, 0, z) sees of a floor, two side walls and an end."""
    c = CAMERA
    value = np.zeros((c["height"], c["width"]))
    for du in (-0.33, 0, 0.33):  # a pixel sees an area, not a point
        for dv in (-0.33, 0, 0.33):
            u, v = np.meshgrid(np.arange(c["width"]) + du, np.arange(c["height"]) + dv)
            rx, ry = (u - c["cx"]) / c["fx"], (v - c["cy"]) / c["fy"]
            with np.errstate(divide="ignore", invalid="ignore"):
                depths = np.stack([np.where(ry > 0, 1.0 / ry, np.inf),
                                   np.where(rx > 0, (2.5 - x) / rx, np.inf),
                                   np.where(rx < 0, (-2.5 - x) / rx, np.inf),
                                   np.full(rx.shape, 20.0 - z)])
            surface = depths.argmin(0)
            depth = depths.min(0)
            px, py, pz = x + rx * depth, ry * depth, z + depth
            s = np.choose(surface, [px, py, py, px]) + 100 * surface
            t = np.choose(surface, [pz, pz, pz, py]) + 50
            value += _texture(s, t)
    return np.clip(np.rint(value / 9), 0, 255).astype(np.uint8)


def stereo_frame(i: int):
    """(left, right, time s, true position of the left camera) of frame i."""
    position = np.array([0.3 * np.sin(0.05 * i), 0, 0.1 * i])
    left = picture(position[0], position[2])
    right = picture(position[0] + CAMERA["baseline"], position[2])
    return left, right, 0.1 * i, position


def run_demo(frames: int) -> int:
    """Tracks the corridor and prints how far the poses are off. Returns an exit status."""
    slam = kys_slam.System(kys_slam.StereoCamera(**CAMERA), {"orb.features": 600})
    truth = []
    for i in range(max(2, frames)):
        left, right, timestamp, position = stereo_frame(i)
        truth.append(position)
        report = slam.feed(left, right, timestamp)
        if report.lost:
            print(f"frame {i} is lost: {report.reason}")
    slam.finish()
    trajectory = slam.trajectory()
    errors = np.linalg.norm(trajectory.poses[:, :3, 3] - np.array(truth), axis=1)
    worst = errors[trajectory.connected].max() if trajectory.connected.any() else np.inf
    print(f"{int(trajectory.connected.sum())} of {len(truth)} frames tracked over "
          f"{truth[-1][2]:.1f} m, largest error {worst:.3f} m, "
          f"{len(slam.landmarks())} landmarks")
    good = trajectory.connected.all() and worst < 0.1
    print("it works" if good else "something is wrong with this installation")
    return 0 if good else 3
