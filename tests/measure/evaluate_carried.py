#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Labels of segments that come late, against the truth of simulated worlds.

    evaluate_carried.py WORLD... [--every 1] [--lag 5] [--frames N] [--build build/release]

WORLD: a folder of simulate_sequence. Its exact segments are given late (System.add_segments), without
motion; mode `verified`, `sequential`. Per keypoint of the left image of a frame with carried segments:
is its class that of the pixel it is at? Keypoints at unlabelled pixels do not count. A keypoint, of what
stands still or of an object that moves from this frame to the next (mover), is one of

new     outside the segmented image, or hidden in it: nothing says what it is
edge    seen, within EDGE px of the border of a segment in one of the two images
flat    seen, without a disparity of its own
inner   seen, none of these

with the share that is right, has no class (unknown), or another one (wrong). The last lines: ATE (m) and
number of frames with a pose. Needs NumPy, OpenCV and the Python package of the build.
"""
import argparse
import csv
import functools
import json
import os
import sys
from collections import Counter, defaultdict

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.join(HERE, "..", "..")
EDGE = 3  # px
SAME = 0.06  # of the disparity: still the same surface
LEAST_SAME = 0.6  # px
VOID = 65535
CAUSES = ("new", "edge", "flat", "inner")
OUTCOMES = ("right", "unknown", "wrong")


def rotation(q):
    """(3, 3) of a quaternion x, y, z, w."""
    x, y, z, w = np.asarray(q) / np.linalg.norm(q)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def place_before(p, objects, camera_now, camera_then, pose_now, pose_then):
    """Points (N, 3) in the camera of one frame, m, in that of an earlier one; NaN where not known.

    objects: (N,) what they are on, -1: the scene. camera_...: (3, 4) camera to world. pose_...: (rotation,
    position) in the world by object."""
    world = p @ camera_now[:, :3].T + camera_now[:, 3]
    for o in set(objects.tolist()) - {-1}:
        on = objects == o
        if o not in pose_now or o not in pose_then:
            world[on] = np.nan
            continue
        (R, t), (R_then, t_then) = pose_now[o], pose_then[o]
        world[on] = (world[on] - t) @ R @ R_then.T + t_then
    return (world - camera_then[:, 3]) @ camera_then[:, :3]


def pixels(uv, shape):
    """Rows, columns, and whether they are in an image of this shape; NaN is not."""
    with np.errstate(invalid="ignore"):
        x, y = (np.nan_to_num(np.floor(uv[:, k] + 0.5), nan=-1, posinf=-1, neginf=-1).astype(int)
                for k in (0, 1))
    inside = (x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0])
    return np.where(inside, y, 0), np.where(inside, x, 0), inside


def near_border(segments):
    """(H, W) bool: another segment within EDGE px, in a square."""
    low, high = segments, segments
    for axis in (0, 1):
        def shifted(image, by, axis=axis):
            width = [(EDGE, EDGE) if a == axis else (0, 0) for a in (0, 1)]
            padded = np.pad(image, width, mode="edge")
            return np.take(padded, np.arange(image.shape[axis]) + EDGE + by, axis)
        steps = range(-EDGE, EDGE + 1)
        low = functools.reduce(np.minimum, (shifted(low, s) for s in steps))
        high = functools.reduce(np.maximum, (shifted(high, s) for s in steps))
    return low != high


def is_seen(disparity_then, y, x, inside, expected):
    """Whether a surface of the expected disparity (px; 0: the sky) is at the pixels or beside them."""
    height, width = disparity_then.shape
    around = np.stack([disparity_then[np.clip(y + b, 0, height - 1), np.clip(x + a, 0, width - 1)]
                       for a in (-1, 0, 1) for b in (-1, 0, 1)])
    with np.errstate(invalid="ignore"):
        near = (np.abs(around - expected) < np.maximum(LEAST_SAME, SAME * expected)).any(0)
    return inside & np.where(expected > 0, near, disparity_then[y, x] == 0)


class Image:
    """The truth of one frame: (H, W) category id, 0 none; object, -1 stuff; disparity in px, 0 none."""

    def __init__(self, labels, objects, disparity):
        self.labels, self.objects, self.disparity = labels, objects, disparity
        self.border = near_border(1000 * (objects.astype(np.int64) + 1) + labels)


class World:
    """The truth of a folder of simulate_sequence."""

    def __init__(self, folder):
        self._folder = folder
        self.cameras = np.loadtxt(os.path.join(folder, "poses.txt")).reshape(-1, 3, 4)
        with open(os.path.join(folder, "panoptic_left.json"), encoding="utf-8") as file:
            self._categories = {a["file_name"]: {s["id"]: s["category_id"] for s in a["segments_info"]}
                                for a in json.load(file)["annotations"]}
        self._objects, self.poses, self.moving = defaultdict(dict), defaultdict(dict), set()
        for row in self._rows("ground_truth.csv"):
            if row["camera"] == "left":
                self._objects[int(row["frame"])][int(row["segment_id"])] = int(row["object"])
                if row["moving"] == "1":
                    self.moving.add((int(row["frame"]), int(row["object"])))
        for row in self._rows("objects.csv"):
            R = rotation([float(row[k]) for k in ("qx", "qy", "qz", "qw")])
            self.poses[int(row["frame"])][int(row["object"])] = (R, np.array([float(row[k]) for k in "xyz"]))
        self.image = functools.lru_cache(16)(self._image)

    def _rows(self, name):
        with open(os.path.join(self._folder, name), encoding="utf-8", newline="") as file:
            yield from csv.DictReader(file)

    def _image(self, n):
        import cv2
        name = f"{n:06d}.png"
        read = lambda kind: cv2.imread(os.path.join(self._folder, kind, name), cv2.IMREAD_UNCHANGED)
        panoptic, disparity = read("panoptic_left").astype(np.int64), read("disparity") / 256.0
        ids = panoptic[..., 2] + 256 * panoptic[..., 1] + 65536 * panoptic[..., 0]
        known = np.array(sorted(self._categories[name]))
        at = np.searchsorted(known, ids).clip(0, len(known) - 1)
        there = known[at] == ids
        look = lambda table, none: np.where(there, np.array([table.get(int(i), none) for i in known])[at], none)
        return Image(look(self._categories[name], 0), look(self._objects[n], -1), disparity)


def judge(world, camera, classes, seen, s, counts):
    """Adds one frame. seen: Observation; s: frame of its segments; classes: category id by label."""
    n = seen.report.index
    now, then = world.image(n), world.image(s)
    y, x, inside = pixels(seen.keypoints, now.labels.shape)
    truth, objects, d = now.labels[y, x], now.objects[y, x], now.disparity[y, x]
    bf = camera.fx * camera.baseline
    depth = bf / np.where(d > 0, d, 1e-4)  # the sky: far
    u, v = seen.keypoints[:, 0], seen.keypoints[:, 1]
    p = np.stack([(u - camera.cx) / camera.fx * depth, (v - camera.cy) / camera.fy * depth, depth], 1)
    q = place_before(p, objects, world.cameras[n], world.cameras[s], world.poses[n], world.poses[s])
    with np.errstate(invalid="ignore", divide="ignore"):
        uv = np.stack([camera.fx * q[:, 0] / q[:, 2] + camera.cx,
                       camera.fy * q[:, 1] / q[:, 2] + camera.cy], 1)
        uv[~(q[:, 2] > 0.05)] = np.nan
        expected = np.where(d > 0, bf / q[:, 2], 0)
    y_then, x_then, inside_then = pixels(uv, now.labels.shape)
    known = is_seen(then.disparity, y_then, x_then, inside_then, expected)
    edge = now.border[y, x] | then.border[y_then, x_then]
    cause = np.select([~known, edge, seen.depths <= 0], CAUSES[:3], CAUSES[3])
    given = np.array([classes[i] if i != VOID else 0 for i in seen.labels])
    outcome = np.select([given == truth, given == 0], OUTCOMES[:2], OUTCOMES[2])
    mover = np.array([(n, o) in world.moving for o in objects.tolist()])
    of = inside & (truth != 0)
    counts.update(zip(mover[of].tolist(), cause[of].tolist(), outcome[of].tolist()))


def ate(estimate, truth):
    """Root mean square of position errors (N, 3) after rigid alignment, m."""
    a, b = estimate - estimate.mean(0), truth - truth.mean(0)
    U, _, Vt = np.linalg.svd(a.T @ b)
    R = U @ np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return float(np.sqrt(((a @ R - b) ** 2).sum(1).mean()))


def run(folder, every, lag, frames=None):
    """Counts by (mover, cause, outcome), the ATE in m, and the number of frames with a pose."""
    import kys_slam
    world, sequence = World(folder), kys_slam.open_sequence(folder)
    space = kys_slam.LabelSpace("coco_panoptic_133")
    counts, observed, latest = Counter(), [], -1
    slam = kys_slam.System(sequence.camera, {
        "kys.mode": "verified", "control.segment_every": every, "control.segment_lag": lag},
        "sequential", observer=observed.append)
    for n, frame in enumerate(sequence):
        if n == frames:
            break
        if n % every == 0:
            image = world.image(n)
            slam.add_segments(n, kys_slam.priors_from_labels(space, image.labels,
                                                             left_instances=image.objects + 1))
        observed.clear()
        latest = max(latest, slam.feed_frame(frame).segments_of)
        if observed and observed[-1].labels is not None and -1 < latest < n:
            judge(world, sequence.camera, list(space.ids), observed[-1], latest, counts)
    slam.finish()
    trajectory = slam.trajectory()
    connected = trajectory.connected
    truth = world.cameras[:len(connected), :, 3][connected]
    return counts, ate(trajectory.poses[connected][:, :3, 3], truth), int(connected.sum())


def rows(counts):
    """(what, cause, keypoints, shares in %) for static and mover, all, seen, and each cause."""
    for mover, what in ((False, "static"), (True, "mover")):
        for name, causes in (("all", CAUSES), ("seen", CAUSES[1:]), *((c, (c,)) for c in CAUSES)):
            of = [sum(counts[mover, c, o] for c in causes) for o in OUTCOMES]
            if sum(of) > 0:
                yield what, name, sum(of), [100 * k / sum(of) for k in of]


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("world", nargs="+")
    parser.add_argument("--every", type=int, default=1, help="frames between segmentations")
    parser.add_argument("--lag", type=int, default=5, help="frames")
    parser.add_argument("--frames", type=int, help="the first ones only")
    parser.add_argument("--build", default=os.path.join(ROOT, "build", "release"))
    options = parser.parse_args()
    sys.path.insert(0, os.path.join(options.build, "python"))
    print("world  of  cause  keypoints  right, %  unknown, %  wrong, %")
    for folder in options.world:
        name = os.path.basename(os.path.normpath(folder))
        counts, error, connected = run(folder, options.every, options.lag, options.frames)
        for what, cause, count, shares in rows(counts):
            print(f"{name}  {what}  {cause}  {count}  " + "  ".join(f"{s:.1f}" for s in shares))
        print(f"{name}  ATE {error:.4f} m, {connected} frames", flush=True)


if __name__ == "__main__":
    main()
