# SPDX-License-Identifier: BSD-3-Clause
"""tools/experiments/long_run.py: its path, its table, and half a minute of it."""
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BIN = pathlib.Path(os.environ.get("KYS_BUILD", SOURCE / "build" / "release")) / "bin"
TOOL = SOURCE / "tools" / "experiments" / "long_run.py"
sys.path.insert(0, str(TOOL.parent))
import long_run  # noqa: E402


class LongRun(unittest.TestCase):
    def test_the_path_is_one_that_a_robot_can_go(self):
        for k in range(0, 20 * 600, 7):
            (before, heading), (after, turned) = long_run.body(k / 20), long_run.body((k + 1) / 20)
            self.assertLess(math.dist(before, after) * 20, 1.2)  # m/s
            self.assertLess(abs(math.remainder(turned - heading, 2 * math.pi)) * 20, 1)  # rad/s
            self.assertLess(max(map(abs, after)), 4)  # m

    def test_laps_differ(self):
        (first, _), (second, _) = long_run.body(3), long_run.body(3 + long_run.LAP)
        self.assertGreater(math.dist(first, second), 0.1)

    def test_a_row_per_part(self):
        frames = [{"index": str(k), "ms_total": str(k % 10), "keyframe": str(int(k % 5 == 0)),
                   "resident_mb": str(30 + k), "matches": "200"} for k in range(20)]
        rows = long_run.table(frames, 2).splitlines()
        self.assertEqual(rows[2], "| 0-9 | 4.50 | 9.00 | 4.50 | 2 | 39 | 200 |")
        self.assertEqual(rows[3].split(" | ")[0], "| 10-19")

    @unittest.skipUnless((BIN / "simulate_features").exists() and (BIN / "run_stereo_euroc").exists(), "not built")
    def test_half_a_minute(self):
        with tempfile.TemporaryDirectory() as folder:
            done = subprocess.run([sys.executable, TOOL, "--output", folder, "--minutes", "0.5", "--bin", BIN],
                                  capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn("600 of 600 frames connected", done.stdout)
            self.assertEqual(len([r for r in done.stdout.splitlines() if r.startswith("|")]), 12)
            self.assertEqual(sorted(os.listdir(folder)), ["long_run.md", "path.tum.txt", "run"])

    def test_a_build_without_programs_is_named(self):
        with tempfile.TemporaryDirectory() as folder:
            done = subprocess.run([sys.executable, TOOL, "--output", folder, "--bin", folder],
                                  capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 2)
            self.assertIn("no such program", done.stderr)


if __name__ == "__main__":
    unittest.main()
