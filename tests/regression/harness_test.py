#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What the comparison of trajectories and the bands rest on."""
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
import unittest.mock

import harness
from compare_builds import differences
from drive import drive_text
from harness import compare, is_exact, largest_difference
from record import band_of_ate

TRACK = [[0.1 * i, 0.01 * i * i, math.sin(0.3 * i)] for i in range(40)]
ROWS = [[i] + [round(v, 4) for v in TRACK[i]] for i in range(0, 40, 3)]


def turned(points, angle, shift):
    c, s = math.cos(angle), math.sin(angle)
    return [[c * x - s * y + shift, s * x + c * y, z - shift] for x, y, z in points]


class Comparison(unittest.TestCase):
    def test_a_rigid_motion_is_no_difference(self):
        for angle in (0, 0.001, 0.5, 2.5, math.pi):
            self.assertLess(largest_difference(ROWS, turned(TRACK, angle, 3)), 2e-4)

    def test_a_bend_is_one(self):
        bent = [list(p) for p in TRACK]
        for i in range(20, 40):
            bent[i][2] += 0.1
        self.assertGreater(largest_difference(ROWS, bent), 0.03)
        self.assertLess(largest_difference(ROWS, bent), 0.1)

    def test_a_mirror_image_is_one(self):
        self.assertGreater(largest_difference(ROWS, [[x, y, -z] for x, y, z in TRACK]), 0.5)

    def test_without_alignment_a_shift_counts(self):
        shifted = [[x + 0.25, y, z] for x, y, z in TRACK]
        self.assertAlmostEqual(largest_difference(ROWS, shifted, align=False), 0.25, places=3)

    def test_a_shorter_run_is_infinitely_far(self):
        self.assertEqual(largest_difference(ROWS, TRACK[:30]), math.inf)

    def test_exact(self):
        expected = {"trajectory": {"positions": ROWS, "alignment": "SE(3), Umeyama", "band": 0.01}}
        self.assertTrue(is_exact(expected, {"positions": TRACK}))
        other = [list(p) for p in TRACK]
        other[3][0] += 2e-4
        self.assertFalse(is_exact(expected, {"positions": other}))
        self.assertEqual(compare(expected, {"positions": other})[1], [])
        other[3][0] += 0.1
        self.assertEqual(compare(expected, {"positions": other})[1], ["trajectory"])


class Bands(unittest.TestCase):
    def test_the_narrower_spread_but_not_less_than_two_millimetres(self):
        self.assertEqual(band_of_ate(0.1, 0.01, [0.11, 0.095]), [0.08, 0.12])
        self.assertEqual(band_of_ate(0.1, 0.003, [0.2]), [0.091, 0.109])
        self.assertEqual(band_of_ate(0.1, 0.0, [0.1]), [0.098, 0.102])
        self.assertEqual(band_of_ate(0.001, 1, [0.3]), [0.0, 0.599])


class StubPrograms(unittest.TestCase):
    """Tests of the case `drive` with stubs of its programs."""

    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.build = pathlib.Path(temporary.name)
        (self.build / "bin").mkdir()
        self.program("simulate_features", 'echo x > "$2"')

    def program(self, name, text):
        """$2 is the output."""
        path = self.build / "bin" / name
        path.write_text('#!/bin/sh\nwhile [ "$1" != --output ]; do shift; done\n' + text + "\n")
        path.chmod(0o755)


class Broken(StubPrograms):
    def check(self, status):
        """Status of check.py --broken with a run whose ATE is 50 m, and its last line."""
        summary = json.dumps({"complete": True, "frames": 1, "frames_tracked": 1, "ate_se3_rmse_m": 50,
                              "versions": {}})
        self.program("run_stereo_kitti", f"mkdir -p $2; echo '{summary}' > $2/summary.json; "
                     f"echo 1 0 0 0 0 1 0 0 0 0 1 0 > $2/trajectory.kitti; echo lost >&2; exit {status}")
        done = subprocess.run([sys.executable, os.path.join(harness.FOLDER, "check.py"), self.build, "drive",
                               "--broken"], capture_output=True, text=True, check=False)
        return done.returncode, (done.stdout + done.stderr).splitlines()[-1]

    def test_an_error_above_the_band_is_what_it_is_for(self):
        status, said = self.check(0)
        self.assertEqual(status, 0, said)
        self.assertIn("ATE 50.00000 m", said)

    def test_a_run_that_loses_track_is_no_error_above_the_band(self):
        self.assertEqual(self.check(3), (1, "check.py: run_stereo_kitti: status 3: lost"))


class Input(StubPrograms):
    """Its tests run side by side."""

    MAKE = ("import sys, harness; "
            "harness.make_input({'input': {'features': 'drive'}}, 1, harness.BuildFolder(sys.argv[1]))")

    def setUp(self):
        super().setUp()
        self.trajectory = self.build / "regression" / "data" / "drive.txt"

    def make(self):
        harness.make_input({"input": {"features": "drive"}}, 1, harness.BuildFolder(self.build))

    def test_the_trajectory_that_is_there_is_not_written_again(self):
        self.make()
        before = self.trajectory.stat()
        self.make()
        now = self.trajectory.stat()
        self.assertEqual((now.st_ino, now.st_mtime_ns), (before.st_ino, before.st_mtime_ns))
        self.trajectory.write_text("of an earlier version")
        self.make()
        self.assertEqual(self.trajectory.read_text(), drive_text())

    def test_two_processes_make_it_at_the_same_time(self):
        """The other one does all of it after the first has written its file and before it renames it."""
        replace = os.replace

        def other_first(*paths):
            subprocess.run([sys.executable, "-c", self.MAKE, self.build], check=True, cwd=harness.FOLDER)
            replace(*paths)

        with unittest.mock.patch.object(os, "replace", other_first):
            self.make()
        self.assertEqual(self.trajectory.read_text(), drive_text())
        self.assertEqual([p.name for p in self.trajectory.parent.glob("drive.txt*")], ["drive.txt"])


class TwoBuilds(unittest.TestCase):
    FRAMES = "index,inliers,ms_total,resident_mb\n0,120,7.5,24.2\n"

    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folders = [pathlib.Path(temporary.name) / name for name in ("a", "b")]
        for folder in self.folders:
            (folder / "left").mkdir(parents=True)
            (folder / "left" / "000000.kysp").write_bytes(b"priors")
            (folder / "frames.csv").write_text(self.FRAMES)
            (folder / "summary.json").write_text(str(folder))

    def test_what_is_measured_does_not_count(self):
        (self.folders[1] / "frames.csv").write_text(self.FRAMES.replace("7.5,24.2", "9.1,30.0"))
        self.assertEqual(differences(*self.folders), [])

    def test_one_byte_counts(self):
        (self.folders[1] / "left" / "000000.kysp").write_bytes(b"prioRs")
        self.assertEqual(differences(*self.folders), [os.path.join("left", "000000.kysp")])

    def test_a_count_of_a_frame_counts(self):
        (self.folders[1] / "frames.csv").write_text(self.FRAMES.replace("120", "121"))
        self.assertEqual(differences(*self.folders), ["frames.csv"])

    def test_a_missing_file_counts(self):
        (self.folders[0] / "map.ply").write_text("ply")
        self.assertEqual(differences(*self.folders), ["map.ply"])

    def test_single_files(self):
        files = [folder / "drive.features" for folder in self.folders]
        for file in files:
            file.write_bytes(b"0123")
        self.assertEqual(differences(*files), [])
        files[1].write_bytes(b"0124")
        self.assertEqual(differences(*files), ["drive.features"])


class RowsOfRecordings(unittest.TestCase):
    """check_recording.py: what counts as the stored row."""

    ROW = {"name": "clip", "kind": "pair", "schedule": "sequential", "input": "0a", "trajectory": "1b",
           "frames": 60, "connected": 60, "ate_se3_m": 0.07, "versions": {"compiler": "12.2.0"}}

    def setUp(self):
        try:
            import check_recording
        except SystemExit:
            self.skipTest("PyYAML is not installed")
        self.compare = check_recording.compare

    def run_gave(self, **changes):
        return self.compare(self.ROW, {**self.ROW, **changes})

    def test_the_same_figures_pass(self):
        self.assertIn("same", self.run_gave())

    def test_one_other_figure_fails_with_the_same_versions(self):
        for change in ({"trajectory": "2c"}, {"ate_se3_m": 0.0701}, {"connected": 59}):
            with self.assertRaisesRegex(harness.Failure, next(iter(change))):
                self.run_gave(**change)

    def test_other_versions_may_differ_but_not_lose_frames(self):
        other = {"versions": {"compiler": "14.0.6"}, "trajectory": "2c"}
        self.assertIn("trajectory 2c, stored 1b", self.run_gave(**other, connected=59))
        for change in ({"connected": 58}, {"frames": 61}):
            with self.assertRaises(harness.Failure):
                self.run_gave(**other, **change)

    def test_another_recording_is_skipped_and_a_run_that_failed_is_not(self):
        with self.assertRaises(harness.Absent):
            self.run_gave(input="0b")
        with self.assertRaisesRegex(harness.Failure, "status 2"):
            self.run_gave(error="status 2: no such file")


if __name__ == "__main__":
    unittest.main()
