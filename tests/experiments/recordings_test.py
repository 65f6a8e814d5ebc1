# SPDX-License-Identifier: BSD-3-Clause
"""tools/recordings.sh on a small folder: a rendered sequence in two of KITTI's layouts and a broken one.

The rendered sequence is the same in both layouts, so both have to give the same trajectory.
"""
import copy
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("KYS_BUILD", SOURCE / "build" / "release"))
BIN = BUILD / "bin"
FRAMES = 8
# The Python package of the build, where it is current.
PACKAGE = subprocess.run([sys.executable, "-c", "import kys_slam"], check=False, capture_output=True, env={
    **os.environ, "PYTHONPATH": str(BUILD / "python")}).returncode == 0
sys.path.insert(0, str(SOURCE / "tools" / "experiments"))
try:
    import numpy as np

    import raw_drive
    import recording_kinds
    import recording_table
    import recordings
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)
PROGRAMS = all((BIN / p).exists() for p in ("simulate_sequence", "run_stereo_kitti", "evaluate_trajectory"))


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def write_raw_calibration(folder, projections):
    """`projections`: rows P0: to P3: as calib.txt has them."""
    rows = [line.replace(f"P{i}:", f"P_rect_0{i}:") for i, line in enumerate(projections)]
    write(folder / "calib_cam_to_cam.txt", "calib_time: 09-Jan-2012 13:57:47\n" + "\n".join(rows)
          + "\nR_rect_00: 1 0 0 0 1 0 0 0 1\n")


def write_pair(sequence, folder):
    """A KITTI sequence as two folders with Kalibr's calibration and time stamps."""
    right = (sequence / "calib.txt").read_text().splitlines()[1].split()
    f, _, cx, minus_fb, _, _, cy = map(float, right[1:8])
    for i, side in enumerate(("left", "right")):
        shutil.copytree(sequence / f"image_{i}", folder / side)
    camera = ("cam{}:\n  camera_model: pinhole\n  intrinsics: [{f}, {f}, {cx}, {cy}]\n"
              "  distortion_model: radtan\n  distortion_coeffs: [0, 0, 0, 0]\n  resolution: [620, 188]\n")
    write(folder / "camchain.yaml", "".join(camera.format(i, f=f, cx=cx, cy=cy) for i in (0, 1))
          + f"  T_cn_cnm1:\n  - [1, 0, 0, {minus_fb / f}]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n"
          "  - [0, 0, 0, 1]\n")
    shutil.copy(sequence / "times.txt", folder / "times.txt")


class Facts(unittest.TestCase):
    """What recordings.yaml says, applied."""

    def recording(self, name, images=0):
        folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, folder)
        for i in range(images):
            write(pathlib.Path(folder, "left", f"{i:06}.png"), "")
            write(pathlib.Path(folder, "right", f"{i:06}.png"), "")
        return recording_kinds.Recording(name, "pair", folder,
                                         [os.path.join(folder, s) for s in ("left", "right")], [])

    def test_partial_sequences_are_said_to_be(self):
        facts = recordings.known()
        part = lambda name, ran, images=0: recordings.part_of(facts, self.recording(name, images), ran)
        self.assertEqual(part("kitti/06", 1101), "complete")
        self.assertEqual(part("kitti/06", 51), "partial: frames 0-50 of 1101 of kitti/06")
        self.assertEqual(part("kitti_06_clip", 51), "partial: frames 0-50 of 1101 of kitti/06")
        self.assertEqual(part("mine", 3, images=3), "all 3 frames here")
        self.assertEqual(part("mine", 2, images=3), "partial: frames 0-1 of 3")

    def test_wrong_ground_truth_is_left_out_where_it_is(self):
        facts = copy.deepcopy(recordings.known())
        facts["excerpts"]["later"] = {"of": "kitti/00", "first": 5}
        facts["excerpts"]["late"] = {"of": "kitti/00", "first": 100}
        ranges = lambda name, what: recordings.left_out(facts, self.recording(name), what)
        self.assertEqual(ranges("kitti/00", "position"), [[0, 11]])
        self.assertEqual(ranges("kitti/00", "heading"), [[0, 11], [12, 30]])
        self.assertEqual(ranges("later", "position"), [[0, 6]])
        self.assertEqual(ranges("late", "heading"), [])
        self.assertEqual(ranges("kitti/06", "heading"), [])

    def test_every_name_in_the_facts_has_a_meaning(self):
        facts = recordings.known()
        for flaw in facts["flaws"]:
            self.assertIn(flaw["of"], facts["lengths"])
            self.assertLessEqual(*flaw["frames"])
            self.assertIn(flaw["leaves_out"], ("position", "heading"))
            self.assertTrue(flaw["why"])
        for name in (*facts["others"], *facts["rates"]):
            self.assertTrue(name in facts["excerpts"] or name in facts["notes"], name)

    def test_a_complete_sequence_has_the_published_figures_beside_it(self):
        row = {"name": "kitti/01", "schedule": "sequential", "part": "complete", "ate_se3_m": 5.0}
        text = recording_table.markdown(recordings.known(), [row])
        self.assertIn("| kitti/01 | ORB-SLAM3 | 13.11 | - | Table 1 of the paper |", text)
        row["part"] = "partial: frames 0-50 of 1101 of kitti/01"
        self.assertNotIn("13.11", recording_table.markdown(recordings.known(), [row]))


@unittest.skipUnless(PROGRAMS, "programs are not built")
class Accuracy(unittest.TestCase):
    """An arc of 300 m, one metre per frame; the estimate is 2 % too short. The first 12 positions of the
    ground truth are 5 m off."""
    FRAMES = 300

    def figures(self, name):
        output = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, output)
        angles = np.arange(self.FRAMES) / 200
        positions = 200 * np.stack([1 - np.cos(angles), 0 * angles, np.sin(angles)], axis=1)
        truth = positions.copy()
        truth[:12, 1] += 5
        for file, points in (("ground_truth.tum", truth), ("trajectory.tum", 0.98 * positions)):
            write(output / file, "".join(
                f"{0.1 * i:.9f} {x:.9f} {y:.9f} {z:.9f} 0 {np.sin(a / 2):.9f} 0 {np.cos(a / 2):.9f}\n"
                for i, ((x, y, z), a) in enumerate(zip(points, angles))))
        recording = recording_kinds.Recording(name, "KITTI odometry", str(output), [], [])
        times = [0.1 * i for i in range(self.FRAMES)]
        return recordings.accuracy(recordings.known(), recording, str(output), BIN, times)

    def test_without_the_wrong_frames_the_scale_is_all_of_the_error(self):
        row = self.figures("kitti/00")
        self.assertEqual(row["frames_left_out"], [[0, 11]])
        self.assertEqual(row["poses_compared"], self.FRAMES - 12)
        self.assertAlmostEqual(row["scale"], 1 / 0.98, places=4)
        self.assertLess(row["ate_sim3_m"], 0.001)
        self.assertEqual(row["frames_left_out_of_segments"], [[0, 11], [12, 30]])
        # Segments start every 10 frames and end at the first one beyond their length; steps are chords,
        # a little shorter than 1 m. The error is 2 % of the chord of the segment.
        errors = [2 * 400 * np.sin((length + 1) / 400) / length for length in (100, 200)
                  for _ in range(31, self.FRAMES - length - 1, 10)]
        self.assertEqual(row["segments"], len(errors))
        self.assertAlmostEqual(row["t_rel_percent"], np.mean(errors), delta=0.001)
        self.assertEqual(row["r_rel_deg_per_100m"], 0)

    def test_elsewhere_nothing_is_left_out(self):
        row = self.figures("kitti/06")
        self.assertNotIn("frames_left_out", row)
        self.assertEqual(row["poses_compared"], self.FRAMES)
        self.assertGreater(row["ate_sim3_m"], 0.5)


class Input(unittest.TestCase):
    def setUp(self):
        self.root = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.root)

    def test_layouts_are_recognised(self):
        for path in ("dataset/sequences/04/image_0/000000.png", "training/image_02/0001/000000.png",
                     "2011_09_26/2011_09_26_drive_0005_sync/image_00/data/0000000000.png",
                     "MH_01_easy/mav0/cam0/data/1.png", "room1/mav0/cam0/data/1.png",
                     "Scene01/clone/frames/rgb/Camera_0/rgb_00000.jpg", "hand/left/1.png",
                     "hand/right/1.png", "hand/camchain.yaml", "other/left/1.png", "other/right/1.png"):
            write(self.root / path, "")
        found = {r.name: r.kind for r in recording_kinds.find(self.root)}
        self.assertEqual(found, {
            "kitti/04": "KITTI odometry", "tracking/0001": "KITTI Tracking", "euroc/MH01": "EuRoC or TUM-VI",
            "room1": "EuRoC or TUM-VI", "raw/2011_09_26_drive_0005": "KITTI raw",
            "vkitti/Scene01": "Virtual KITTI 2", "hand": "pair"})

    def test_a_second_one_of_a_name_is_another_row_of_the_same_recording(self):
        for pair, camera in (("colour", 2), ("grey", 0)):
            write(self.root / pair / "sequences" / "00" / f"image_{camera}" / "000000.png", "")
        found = recording_kinds.find(self.root)
        self.assertEqual([r.row for r in found], ["kitti/00", "kitti/00 (grey/sequences/00)"])
        for recording in found:  # both without the ground truth that is wrong
            self.assertEqual(recordings.left_out(recordings.known(), recording, "position"), [[0, 11]])

    def test_the_digest_is_of_the_content_wherever_it_is(self):
        def folder(name):
            for side in ("left", "right"):
                write(self.root / name / side / "1.png", side)
                write(self.root / name / side / "2.png", side)
            write(self.root / name / "camchain.yaml", "cam0")
            return next(r for r in recording_kinds.find(self.root) if r.name == name)

        one, other = folder("one"), folder("other")
        digest = one.digest()
        self.assertEqual(digest, other.digest())
        self.assertNotEqual(digest, one.digest(limit=1))
        write(self.root / "other" / "right" / "2.png", "left")
        self.assertNotEqual(digest, other.digest())
        self.assertEqual(one.digest(limit=1), other.digest(limit=1))
        write(self.root / "one" / "camchain.yaml", "cam1")
        self.assertNotEqual(digest, one.digest())


class RawDrive(unittest.TestCase):
    """Worked by hand: the GPS/IMU looks east, y north, z up; the camera's z is forward, y down."""

    def poses(self, packets):
        with tempfile.TemporaryDirectory() as root:
            drive = pathlib.Path(root, "drive")
            for i, packet in enumerate(packets):
                write(drive / "oxts" / "data" / f"{i:010}.txt", " ".join(f"{v:.15g}" for v in packet))
            (drive / "image_00" / "data").mkdir(parents=True)
            (drive / "image_01" / "data").mkdir(parents=True)
            write(drive / "image_00" / "timestamps.txt",
                  "2011-09-26 23:59:59.900000000\n2011-09-27 00:00:00.000000001\n")
            write_raw_calibration(pathlib.Path(root), [f"P{i}: 1 0 0 0 0 1 0 0 0 0 1 0" for i in range(4)])
            write(pathlib.Path(root, "calib_imu_to_velo.txt"), "R: 1 0 0 0 1 0 0 0 1\nT: 0 0 0\n")
            write(pathlib.Path(root, "calib_velo_to_cam.txt"), "R: 0 -1 0 0 0 -1 1 0 0\nT: 0 0 0\n")
            raw_drive.arrange(str(drive), [str(drive / c / "data") for c in ("image_00", "image_01")],
                              os.path.join(root, "out"))
            times = np.loadtxt(os.path.join(root, "out", "times.txt"))
            return times, np.loadtxt(os.path.join(root, "out", "poses.txt")).reshape(-1, 3, 4)

    def test_ten_metres_east_at_the_equator_are_ten_metres_ahead(self):
        degrees = np.degrees(10 / raw_drive.EARTH_RADIUS_M)
        times, poses = self.poses([[0, 8, 100, 0, 0, 0], [0, 8 + degrees, 101, 0, 0, 0]])
        np.testing.assert_allclose(times, [0, 0.100000001], atol=1e-10)
        np.testing.assert_allclose(poses[0], np.eye(4)[:3], atol=1e-9)
        np.testing.assert_allclose(poses[1][:, 3], [0, -1, 10], atol=1e-6)

    def test_a_left_turn_turns_the_camera_about_its_vertical(self):
        _, poses = self.poses([[49, 8, 100, 0, 0, 0], [49, 8, 100, 0, 0, np.pi / 2]])
        np.testing.assert_allclose(poses[1][:, :3] @ [0, 0, 1], [-1, 0, 0], atol=1e-9)


class Comparison(unittest.TestCase):
    ROW = {"name": "a", "kind": "pair", "schedule": "sequential", "input": "11", "trajectory": "22",
           "frames": 5, "ate_se3_m": 0.1, "ms_per_frame": 10}

    def verdict(self, mine, stored=None):
        return recording_table.compare([stored or self.ROW], mine)[0]

    def test_times_and_folder_names_do_not_count(self):
        self.assertEqual(self.verdict([{**self.ROW, "name": "b", "ms_per_frame": 20}])[0], "same")

    def test_every_figure_counts(self):
        for key, value in (("trajectory", "23"), ("input", "12"), ("frames", 4), ("ate_se3_m", 0.2),
                           ("error", "status 2")):
            verdict, line = self.verdict([{**self.ROW, key: value}])
            self.assertEqual(verdict, "differs", key)
            self.assertIn(f"{key} {value}", line)

    def test_another_schedule_is_another_row(self):
        self.assertEqual(self.verdict([{**self.ROW, "schedule": "pipelined"}])[0], "no such recording here")


@unittest.skipUnless(PROGRAMS, "programs are not built")
class Miniature(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.work = pathlib.Path(tempfile.mkdtemp())
        cls.addClassCleanup(shutil.rmtree, cls.work)
        data, sequence = cls.work / "data", cls.work / "data" / "sequences" / "77"
        sequence.parent.mkdir(parents=True)
        subprocess.run([BIN / "simulate_sequence", "block", "--frames", str(FRAMES), "--size", "620x188",
                        "--images-only", "--quiet", "--output", sequence], check=True, capture_output=True)
        drive = data / "2020_01_01" / "2020_01_01_drive_0001_sync"
        for i in (0, 1):
            shutil.copytree(sequence / f"image_{i}", drive / f"image_0{i}" / "data")
        write_raw_calibration(drive.parent, (sequence / "calib.txt").read_text().splitlines()[:4])
        times = [float(t) for t in (sequence / "times.txt").read_text().split()]
        write(drive / "image_00" / "timestamps.txt",
              "".join(f"2020-01-01 12:00:{t:012.9f}\n" for t in times))
        (data / "broken" / "image_0").mkdir(parents=True)
        if PACKAGE:
            write_pair(sequence, data / "hand")
        cls.first = cls.call("first")
        cls.table = cls.work / "first" / "table.json"
        cls.rows = {(r["name"], r["schedule"]): r for r in recording_table.read(cls.table)}

    @classmethod
    def call(cls, output, *more, data="data"):
        return subprocess.run(
            [SOURCE / "tools" / "recordings.sh", "--data", cls.work / data, "--bin", BIN, "--output",
             cls.work / output, *more], capture_output=True, text=True, check=False,
            env={**os.environ, "KYS_PYTHON": sys.executable})

    def test_every_recording_is_a_row_in_both_schedules(self):
        names = ["kitti/77", "raw/2020_01_01_drive_0001", "broken"] + (["hand"] if PACKAGE else [])
        self.assertEqual(set(self.rows), {(n, s) for n in names for s in ("sequential", "pipelined")})
        self.assertIn(f"[{len(self.rows)}/{len(self.rows)}]", self.first.stderr)
        row = self.rows["kitti/77", "sequential"]
        self.assertEqual((row["frames"], row["connected"], row["part"]), (FRAMES, FRAMES, "all 8 frames here"))
        self.assertLess(row["ate_se3_m"], 0.1)  # of a path of metres
        self.assertIn("scale", row)
        self.assertIn(row["trajectory"], (self.work / "first" / "table.md").read_text())

    def test_the_raw_layout_gives_the_same_trajectory(self):
        for schedule in ("sequential", "pipelined"):
            raw = self.rows["raw/2020_01_01_drive_0001", schedule]
            self.assertNotIn("error", raw, raw)
            self.assertEqual(raw["trajectory"], self.rows["kitti/77", schedule]["trajectory"])
            self.assertNotIn("ate_se3_m", raw)  # no GPS/IMU, no ground truth

    @unittest.skipUnless(PACKAGE, "the Python package is not built")
    def test_a_pair_of_folders_runs_by_the_python_package(self):
        row = self.rows["hand", "sequential"]
        self.assertNotIn("error", row, row)
        self.assertEqual((row["frames"], row["connected"]), (FRAMES, FRAMES))
        self.assertNotIn("ate_se3_m", row)

    def test_a_broken_recording_is_a_row_with_its_message(self):
        self.assertEqual(self.first.returncode, 1)
        row = self.rows["broken", "sequential"]
        self.assertIn("calib.txt: no such file", row["error"])
        self.assertNotIn(str(self.work), row["error"])

    def test_check_says_same_differs_and_absent(self):
        rows = json.loads(self.table.read_text())["rows"]
        changed = next(r for r in rows if (r["name"], r["schedule"]) == ("kitti/77", "pipelined"))
        changed["trajectory"] = "0" * 12
        rows.append({"name": "kitti/00", "schedule": "pipelined", "input": "1"})
        stored = self.work / "stored.json"
        stored.write_text(json.dumps({"rows": rows}))
        done = self.call("again", "--check", stored)
        said = dict(line.split(": ", 1) for line in done.stdout.splitlines())
        self.assertEqual(said.pop("kitti/00, pipelined"), "no such recording here")
        self.assertTrue(said.pop("kitti/77, pipelined").startswith("differs: trajectory "))
        self.assertEqual(set(said.values()), {"same"}, said)
        self.assertEqual(len(said), len(self.rows) - 1)
        self.assertEqual(done.returncode, 1)
        done = self.call("again", "--check", self.table, "--only", "kitti/77")
        self.assertEqual((done.returncode, done.stdout.count(": same")), (0, 2), done.stdout)

    def test_the_page_keeps_what_is_outside_its_markers(self):
        page = self.work / "page.md"
        write(page, f"before\n{recording_table.BEGIN}\nold\n{recording_table.END}\nafter\n")
        for _ in range(2):  # the second one replaces the first one's part
            self.call("page", "--page", page, "--only", "kitti/77", "--schedules", "sequential")
        text = page.read_text()
        self.assertTrue(text.startswith("before\n") and text.endswith("after\n"))
        self.assertNotIn("old", text)
        self.assertEqual(text.count("| kitti/77 | sequential |"), 1)

    def test_bad_input_ends_with_one_line(self):
        write(self.work / "no_markers.md", "text\n")
        write(self.work / "table_without_rows.json", "{}")
        (self.work / "empty").mkdir(exist_ok=True)
        for more, data, said in ((["--page", self.work / "no_markers.md"], "data", "markers"),
                                 (["--check", self.work / "table_without_rows.json"], "data", "rows"),
                                 ([], "empty", "no recording"), ([], "nowhere", "no such folder")):
            done = self.call("bad", *more, data=data)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(said, done.stderr)
            self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)


if __name__ == "__main__":
    unittest.main()
