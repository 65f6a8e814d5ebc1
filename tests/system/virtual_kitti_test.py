#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A simulated street as a Virtual KITTI 2 folder, from its pictures to a trajectory, beside the same
frames as KITTI odometry with COCO panoptic maps.

    KYS_BUILD=build/release virtual_kitti_test.py
"""
import csv
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SKIPPED = 77
if any(importlib.util.find_spec(name) is None for name in ("numpy", "PIL")):
    print("no NumPy or no Pillow")
    sys.exit(SKIPPED)

import numpy as np  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "regression"))
import harness  # noqa: E402
import virtual_kitti  # noqa: E402

PLACE = harness.BuildFolder(os.environ["KYS_BUILD"])
FRAMES, MIDDLE = 30, 15
CASE = {"input": {"world": "street", "size": "620x188", "frames": FRAMES, "priors": True},
        # By votes the truck ahead captures the tracker: only priors that are right free it.
        "run": {"program": "run_stereo_kitti",
                "arguments": ["--schedule", "sequential", "--set", "tracking.image_area=false"]}}
NEAR = 3.0  # m. Nearer, whole centimetres of depth move the predicted flow by up to half a pixel.


def coco_command(world, output):
    command = [PLACE.program("build_priors"), world, "--quiet", "--output", output]
    for source in ("disparity", "disparity_right", "flow_left", "flow_right", "panoptic_left",
                   "panoptic_right"):
        command += ["--" + source.replace("_", "-"), Path(world, source)]
    return [str(word) for word in command]


def vkitti_command(scene, output):
    frames = Path(scene, "frames")
    command = [PLACE.program("build_priors"), scene, "--quiet", "--output", output,
               "--label-space", "vkitti2", "--disparity-encoding", "vkitti",
               "--flow-encoding", "vkitti", "--disparity", frames / "depth" / "Camera_0",
               "--disparity-right", frames / "depth" / "Camera_1"]
    for c, camera in virtual_kitti.CAMERAS:
        command += [f"--panoptic-{camera}", frames / "instanceSegmentation" / f"Camera_{c}",
                    f"--flow-{camera}", frames / "forwardFlow" / f"Camera_{c}"]
    return [str(word) for word in command]


def run(arguments, mode, name, settings=()):
    case = {"run": {**CASE["run"], "arguments": [*CASE["run"]["arguments"], "--mode", mode]}}
    folder = harness.run(case, f"virtual_kitti-{name}-{mode}", arguments, settings, PLACE)
    return folder, harness.read_results(folder)


def rows_of(priors):
    with open(Path(priors, "segments.csv"), newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def is_moving(row):
    return "1" in (row["magnitude_test"], row["radial_test"])


def rotation(x, y, z, w):
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


class VirtualKitti(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        world = harness.make_input(CASE, 1, PLACE)[0]
        cls.world = virtual_kitti.World(world)
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        cls.scene = cls.folder / "Scene01" / "clone"
        virtual_kitti.convert(cls.world, cls.scene)
        cls.coco_priors, cls.vkitti_priors = cls.folder / "coco", cls.folder / "vkitti"
        harness.call(coco_command(world, cls.coco_priors))
        harness.call(vkitti_command(cls.scene, cls.vkitti_priors))

    def run_both(self, mode):
        """The runs on the COCO and on the Virtual KITTI input."""
        world = [str(self.world.folder), "--priors", str(self.coco_priors)]
        scene = [str(self.scene), "--priors", str(self.vkitti_priors)]
        return (run(world, mode, "coco"),
                run(scene, mode, "vkitti", ["control.label_space=vkitti2"]))

    def decisions(self):
        """Rows of both tables by frame, camera and vehicle."""
        coco, vkitti = {}, {}
        for row in rows_of(self.coco_priors):
            key = int(row["frame"]), row["camera"]
            vehicle = self.world.object_of.get((*key, int(row["input_id"])))
            if vehicle is not None:
                coco[*key, vehicle] = row
        vehicle_of = {i: o for o, i in self.world.instance_of.items()}
        for row in rows_of(self.vkitti_priors):
            frame = int(row["frame"].removeprefix("rgb_"))
            vkitti[frame, row["camera"], vehicle_of[int(row["input_id"])]] = row
        return coco, vkitti

    def test_ground_truth_is_the_worlds(self):
        folder, results = run([str(self.scene)], "stock", "images")
        self.assertEqual(results["completeness"], 1)
        truth = np.loadtxt(Path(folder, "ground_truth.tum"))
        self.assertEqual(len(truth), FRAMES)
        np.testing.assert_allclose(truth[:, 0], 0.1 * np.arange(FRAMES), atol=1e-9)
        # The tables have seven digits.
        np.testing.assert_allclose(truth[:, 1:4], self.world.poses[:, :, 3], atol=3e-4)
        turns = np.array([rotation(*row[4:]) for row in truth])
        np.testing.assert_allclose(turns, self.world.poses[:, :, :3], atol=2e-6)

    def test_the_same_vehicles_move(self):
        coco, vkitti = self.decisions()
        self.assertEqual(set(coco), set(vkitti))
        self.assertGreater(sum(map(is_moving, coco.values())), 100)
        self.assertGreater(sum(not is_moving(row) for row in coco.values()), 100)
        otherwise = 0
        for key, expected in coco.items():
            found = vkitti[key]
            self.assertEqual(found["area_px"], expected["area_px"], key)
            depth = float(expected["mean_depth_m"])
            self.assertAlmostEqual(float(found["mean_depth_m"]), depth, delta=0.002 * depth, msg=key)
            # What a centimetre of depth is worth in flow grows with the square of nearness.
            self.assertAlmostEqual(float(found["residual_px"]), float(expected["residual_px"]),
                                   delta=0.02 + 2 / max(depth, 1)**2, msg=key)
            if is_moving(found) != is_moving(expected):
                self.assertLess(depth, NEAR, key)
                otherwise += 1
        self.assertLessEqual(otherwise, 2)

    def test_trajectory(self):
        accuracy = {}
        for mode in ("stock", "kys"):
            for name, (_, results) in zip(("coco", "vkitti"), self.run_both(mode)):
                self.assertEqual(results["completeness"], 1, (mode, name))
                accuracy[mode, name] = results["ate"]
        self.assertLess(accuracy["kys", "vkitti"], 1.5 * accuracy["kys", "coco"] + 0.005)
        # The truck ahead takes the tracker along, unless its motion is known.
        self.assertLess(accuracy["kys", "vkitti"], 0.1 * accuracy["stock", "vkitti"])

    def copy_scene(self):
        copy = self.folder / "spoilt" / "clone"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(self.scene, copy, copy_function=os.link)  # files are replaced, not changed
        return copy

    def expect_refused(self, command, program, file):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 2, done.stderr)
        # The truck ahead may be warned of before.
        errors = [line for line in done.stderr.splitlines() if "[warning]" not in line]
        self.assertEqual(len(errors), 1, done.stderr)
        self.assertTrue(errors[0].startswith(f"{program}: "), done.stderr)
        self.assertIn(file, errors[0])

    def test_bad_pictures_are_named(self):
        files = ["depth/Camera_0/depth", "depth/Camera_1/depth",
                 "forwardFlow/Camera_0/flow", "forwardFlow/Camera_1/flow",
                 "instanceSegmentation/Camera_0/instancegt", "classSegmentation/Camera_1/classgt"]
        for file in files:
            for kind in ("missing", "truncated"):
                with self.subTest(file=file, kind=kind):
                    scene = self.copy_scene()
                    path = scene / "frames" / f"{file}_{MIDDLE:05d}.png"
                    content = path.read_bytes()
                    path.unlink()
                    if kind == "truncated":
                        path.write_bytes(content[:len(content) // 2])
                    command = vkitti_command(scene, self.folder / "refused")
                    command += ["--start", str(MIDDLE - 2), "--frames", "4", "--rebuild"]
                    self.expect_refused(command, "build_priors", path.name)

    def test_encodings_that_are_not_given(self):
        command = vkitti_command(self.scene, self.folder / "refused")
        for option, file in (("--disparity-encoding", "depth_00000.png"),
                             ("--flow-encoding", "flow_00000.png")):
            at = command.index(option)
            self.expect_refused(command[:at] + command[at + 2:], "build_priors", file)

    def test_bad_images_and_tables_are_named(self):
        def refused(scene, file):
            self.expect_refused([PLACE.program("run_stereo_kitti"), str(scene), "--quiet",
                                 "--output", str(self.folder / "run")], "run_stereo_kitti", file)

        scene = self.copy_scene()
        path = scene / "frames" / "rgb" / "Camera_1" / f"rgb_{MIDDLE:05d}.jpg"
        content = path.read_bytes()
        path.unlink()
        path.write_bytes(content[:len(content) // 2])
        refused(scene, path.name)
        for table in ("extrinsic.txt", "intrinsic.txt"):
            scene = self.copy_scene()
            lines = (scene / table).read_text().splitlines(keepends=True)
            (scene / table).unlink()
            refused(scene, table)
            middle = "".join(lines[:2 * MIDDLE])
            (scene / table).write_text(middle + lines[2 * MIDDLE][:20] + "\n")
            refused(scene, f"{table}:{2 * MIDDLE + 1}")
        (scene / "intrinsic.txt").write_text("".join(lines))
        lines = (self.scene / "extrinsic.txt").read_text().splitlines(keepends=True)
        (scene / "extrinsic.txt").unlink()
        (scene / "extrinsic.txt").write_text("".join(lines[:2 * MIDDLE]))
        refused(scene, "extrinsic.txt: no pose of both cameras for rgb_00014")


def main():
    try:
        for program in ("simulate_sequence", "build_priors", "run_stereo_kitti"):
            PLACE.program(program)
    except harness.Absent as reason:
        print(reason)
        return SKIPPED
    return 0 if unittest.main(exit=False).result.wasSuccessful() else 1


if __name__ == "__main__":
    sys.exit(main())
