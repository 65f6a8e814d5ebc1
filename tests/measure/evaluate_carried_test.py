#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""evaluate_carried.py on a scene that is made up: a camera that goes 1 m ahead, a wall, and a box that moves."""
import os
import sys
import types
import unittest
from collections import Counter

try:
    import numpy as np
except ImportError:
    print("skipped: numpy is missing")
    sys.exit(77)

import evaluate_carried as carried

CAMERA = types.SimpleNamespace(fx=100.0, fy=100.0, baseline=0.5, cx=50.0, cy=30.0)
WALL, BOX = 175, 3  # categories
WALL_DEPTH, BOX_DEPTH = 20.0, 10.0  # m, seen now
OBJECT = 7
I = np.eye(3)


def image(box, depths):
    """`box`: columns (first, end) of rows 20 to 39. `depths`: m, of wall and box."""
    labels, objects = np.full((60, 100), WALL), np.full((60, 100), -1)
    disparity = np.full((60, 100), CAMERA.fx * CAMERA.baseline / depths[0])
    rows = slice(20, 40), slice(*box)
    labels[rows], objects[rows], disparity[rows] = BOX, OBJECT, CAMERA.fx * CAMERA.baseline / depths[1]
    return carried.Image(labels, objects, disparity)


class Scene:
    """Frame 1 is 1 m ahead of frame 0; the box was 2 m to the left then and 1 m farther."""

    cameras = [np.hstack([I, [[0], [0], [z]]]) for z in (0.0, 1.0)]
    poses = [{OBJECT: (I, np.array([-2.0, 0, 12]))}, {OBJECT: (I, np.array([0.0, 0, 11]))}]
    moving = {(1, OBJECT)}

    def image(self, n):
        return image((60, 80), (WALL_DEPTH, BOX_DEPTH)) if n else image((41, 58), (WALL_DEPTH + 1, 12.0))


def seen(points):
    """points: (u, v, has a disparity, label given)."""
    u, v, deep, labels = zip(*points)
    return types.SimpleNamespace(
        report=types.SimpleNamespace(index=1), keypoints=np.stack([u, v], 1).astype(float),
        depths=np.where(deep, 1.0, -1.0), labels=np.array(labels))


class Judgement(unittest.TestCase):
    CLASSES = [WALL, BOX]

    def judge(self, *points):
        counts = Counter()
        carried.judge(Scene(), CAMERA, self.CLASSES, seen(points), 0, counts)
        return counts

    def test_every_cause_and_outcome(self):
        # A point of the box is 2 m to the left and 2 m farther in the camera of frame 0, at 41 to 57 px.
        self.assertEqual(self.judge((10, 10, True, 0)), {(False, "inner", "right"): 1})
        self.assertEqual(self.judge((10, 10, False, carried.VOID)), {(False, "flat", "unknown"): 1})
        self.assertEqual(self.judge((58, 30, True, 1)), {(False, "edge", "wrong"): 1})
        self.assertEqual(self.judge((48, 30, True, 1)), {(False, "new", "wrong"): 1})
        self.assertEqual(self.judge((70, 30, True, 1)), {(True, "inner", "right"): 1})
        self.assertEqual(self.judge((61, 30, True, 0)), {(True, "edge", "wrong"): 1})

    def test_what_is_outside_of_the_image_or_without_a_label_does_not_count(self):
        self.assertEqual(self.judge((-5, 10, True, 0), (200, 10, True, 0)), {})

    def test_shares(self):
        rows = list(carried.rows(self.judge((10, 10, True, 0), (12, 10, True, 1), (48, 30, True, 0))))
        self.assertEqual([row[:3] for row in rows], [("static", "all", 3), ("static", "seen", 2),
                                                     ("static", "new", 1), ("static", "inner", 2)])
        self.assertEqual(rows[1][3], [50, 0, 50])


class Geometry(unittest.TestCase):
    def test_places_of_the_scene_and_of_an_object(self):
        p = np.array([[1.0, 0, 5], [0, 0, 10], [0, 0, 10]])
        q = carried.place_before(p, np.array([-1, OBJECT, 99]), Scene.cameras[1], Scene.cameras[0],
                                 Scene.poses[1], Scene.poses[0])
        np.testing.assert_allclose(q[:2], [[1, 0, 6], [-2, 0, 12]])
        self.assertTrue(np.isnan(q[2]).all())

    def test_borders(self):
        near = carried.near_border(np.repeat([[1, 1, 1, 1, 1, 2, 2, 2, 2, 2]], 4, axis=0))
        self.assertEqual(near[1].tolist(), [False] * 2 + [True] * 6 + [False] * 2)

    def test_pixels(self):
        y, x, inside = carried.pixels(np.array([[1.6, 0.2], [np.nan, 1], [-0.6, 1], [4, 1]]), (3, 4))
        self.assertEqual(inside.tolist(), [True, False, False, False])
        self.assertEqual((y[0], x[0]), (0, 2))

    def test_a_rigid_motion_is_no_error(self):
        a = np.random.default_rng(1).normal(size=(20, 3))
        R = carried.rotation([0.1, 0.2, -0.3, 0.9])
        self.assertLess(carried.ate(a @ R.T + [1, 2, 3], a), 1e-12)
        self.assertGreater(carried.ate(2 * a, a), 0.5)


if __name__ == "__main__":
    unittest.main()
