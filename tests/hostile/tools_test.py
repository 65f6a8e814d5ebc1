#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Python tools under tools/ on missing, damaged and unwritable files: one line that names the file,
status 2. Skipped without NumPy or SciPy."""
import csv
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
TOOLS = ROOT / "tools"
try:
    import numpy  # noqa: F401
    import scipy  # noqa: F401

    sys.path[:0] = [str(TOOLS / "experiments"), str(TOOLS / "common")]
    import drive_tables
    import inputs
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

SEGMENTS = ["frame", "camera", "input_id", "part", "identity", "label", "area_px", "mean_depth_m", "residual_px",
            "radial_px", "coverage", "omega", "magnitude_test", "radial_test", "rho"]
TRUTH = ["frame", "camera", "segment_id", "object", "isthing", "moving"]


class Tools(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)
        self.segments = self.table("priors/segments.csv", SEGMENTS, [[0] * len(SEGMENTS)])
        self.truth = self.table("truth.csv", TRUTH, [[0] * len(TRUTH)])
        self.classes = ROOT / "kys" / "data" / "vkitti2.classes.csv"

    def table(self, name, header, rows):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(path, "w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([header, *rows])
        return path

    def call(self, tool, *arguments):
        return subprocess.run([sys.executable, str(TOOLS / tool), *map(str, arguments)],
                              capture_output=True, text=True, check=False, cwd=self.folder)

    def refused(self, *command):
        done = self.call(*command)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertNotIn("Traceback", done.stderr)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        return done.stderr

    # --- tables --------------------------------------------------------------------------------

    def test_rows_have_the_types_that_are_asked_for(self):
        path = self.table("t.csv", ["a", "b", "c"], [[1, 2.5, "x"], [3, 4, ""]])
        rows = inputs.read_table(path, {"a": int, "b": float})
        self.assertEqual(rows, [{"a": 1, "b": 2.5, "c": "x"}, {"a": 3, "b": 4.0, "c": ""}])

    def test_damaged_tables_name_file_and_line(self):
        path = self.folder / "t.csv"
        for content, said in ((b"", "no column a"), (b"b\n1\n", "no column a"), (b"a\nx\n", ":2: "),
                              (b"a,b\n1,2\n3\n", ":3: not 2 fields"), (b"a\n1,2\n", ":2: not 1 fields"),
                              (b"a\n\xff\n", "utf-8")):
            path.write_bytes(content)
            with self.assertRaisesRegex(inputs.InputError, "t.csv.*" + said):
                inputs.read_table(path, {"a": int})

    # --- tools that read tables ----------------------------------------------------------------

    def commands(self):
        """Tool, arguments, file that it needs."""
        truth, priors = self.truth, self.segments.parent
        return ((("priors/score_detection.py", priors, truth), (self.segments, truth)),
                (("priors/score_identities.py", priors, truth), (self.segments, truth)),
                (("perception/evaluate_kitti_06.py", priors, "--classes", self.classes), (self.segments,)))

    def test_missing_files_and_columns(self):
        for command, files in self.commands():
            for file in files:
                whole = file.read_bytes()
                for content in (None, b"x\n1\n", b"\xff\xfe", whole.replace(b"0", b"x")):
                    file.unlink()
                    if content is not None:
                        file.write_bytes(content)
                    if content != whole.replace(b"0", b"x") or file == self.segments:
                        self.assertIn(file.name, self.refused(*command))
                    file.write_bytes(whole)

    def test_fit_perception(self):
        said = self.refused("simulator/perception/fit_perception.py", "none:exact:estimated")
        self.assertIn("none", said)

    def test_class_files(self):
        bad = self.folder / "bad.classes.csv"
        for text in ("", "kys-classes,1,x,1\n", "kys-classes,1,x,1\nid,thing,vector,text,name\na,1,b,c,d\n",
                     "kys-classes,1,x,1\nid,thing,vector,text,name\n1,1\n"):
            bad.write_text(text)
            said = self.refused("perception/evaluate_kitti_06.py", self.segments.parent, "--classes", bad)
            self.assertIn("bad.classes.csv", said)

    def test_loop_recall(self):
        run = self.folder / "run"
        run.mkdir()
        (run / "ground_truth.tum").write_text("0 0 0 0 0 0 0 1\n")
        (run / "graph.csv").write_text("a,b,c\n0,0,0\n")
        self.assertIn("frames.csv", self.refused("experiments/loop_recall.py", run))
        self.table("run/frames.csv", ["index", "timestamp"], [[0, 0]])
        self.assertIn("no column loop", self.refused("experiments/loop_recall.py", run))

    def test_compare_features(self):
        self.assertIn("no world of simulate_sequence",
                      self.refused("experiments/compare_features.py", self.folder, "--output", self.folder / "out"))

    def test_lose_images(self):
        self.assertIn("image_0", self.refused("experiments/lose_images.py", self.folder / "nowhere", "--output", "x"))
        full = self.folder / "full"
        (full / "inside").mkdir(parents=True)
        self.assertIn("is not empty", self.refused("experiments/lose_images.py", self.folder, "--output", full))

    def test_import_tables(self):
        arguments = ("--semantics", self.folder, "--output", self.folder / "out")
        self.assertIn("coco_panoptic_133.json", self.refused("semantics/import_tables.py", *arguments))
        for name in ("coco_panoptic_133.json", "coco133_hamming_ftvec.json"):
            (self.folder / name).write_text("{}")
        self.assertIn(str(self.folder), self.refused("semantics/import_tables.py", *arguments))

    # --- drives --------------------------------------------------------------------------------

    def programs(self):
        """Programs of which the one that tracks fails. The one that simulates lists its calls."""
        folder = self.folder / "bin"
        folder.mkdir()
        texts = {"simulate_features": f'echo "$*" >> {folder}/calls; ' +
                                      'while [ $# -gt 1 ]; do if [ "$1" = --output ]; then echo x > "$2"; fi; '
                                      'shift; done',
                 "run_stereo_kitti": "echo 'run_stereo_kitti: no mode nosuchmode' >&2; exit 2",
                 "evaluate_trajectory": "exit 2"}
        for name, text in texts.items():
            (folder / name).write_text("#!/bin/sh\n" + text + "\n")
            (folder / name).chmod(0o755)
        (self.folder / "truth" / "kitti").mkdir(parents=True)
        (self.folder / "truth" / "kitti" / "07.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
        return folder

    def test_drives_without_trajectories(self):
        self.assertIn("nonexistent", self.refused("experiments/drives.py", "/nonexistent", "--output", "o"))
        (self.folder / "file").touch()
        self.assertIn("file", self.refused("experiments/drives.py", "/nonexistent", "--output",
                                           self.folder / "file" / "o"))

    def test_a_drive_that_fails_is_a_row_with_its_reason(self):
        done = self.call("experiments/drives.py", self.folder / "truth", "--output", self.folder / "o",
                         "--bin", self.programs(), "--traffic", "none", "--perception", "exact", "--seeds",
                         "1,2", "--modes", "nosuchmode")
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertNotIn("Traceback", done.stderr)
        with open(self.folder / "o" / "drives.csv", newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        self.assertEqual([r["seed"] for r in rows], ["1", "2"])
        self.assertTrue(all("no mode nosuchmode" in r["failed"] for r in rows))

    def test_drives_that_differ_in_perception_are_simulated_at_once(self):
        programs = self.programs()
        arguments = ("experiments/drives.py", self.folder / "truth", "--output", self.folder / "o", "--bin",
                     programs, "--traffic", "none,city", "--perception", "exact,poor", "--seeds", "1",
                     "--modes", "kys,stock")
        track = programs / "run_stereo_kitti"
        track.write_text('#!/bin/sh\nfor i; do if [ "$o" = --output ]; then o=$i; break; fi; o=$i; done\n'
                         'mkdir -p "$o"; echo \'{"frames": 2, "frames_tracked": 2, "loops_closed": 0, '
                         '"keyframes": 1, "submaps": 1}\' > "$o/summary.json"\n')
        self.call(*arguments)
        calls = (programs / "calls").read_text().splitlines()
        self.assertEqual([call.count("--output") for call in calls], [2, 2])
        self.assertTrue(all("--perception exact,poor" in call for call in calls), calls)
        with open(self.folder / "o" / "drives.csv", newline="", encoding="utf-8") as file:
            rows = [(r["traffic"], r["perception"], r["mode"]) for r in csv.DictReader(file)]
        self.assertEqual(rows, [(traffic, *rest) for traffic in ("none", "city") for rest in (
            ("exact", "kys"), ("exact", "stock"), ("poor", "kys"))])
        table = self.call("experiments/drive_tables.py", self.folder / "o" / "drives.csv")
        self.assertIn("over stock", table.stdout)
        self.assertIn("nothing.csv", self.refused("experiments/drive_tables.py", self.folder / "nothing.csv"))
        # A second call has the runs. A missing one is made with its own perception alone.
        self.call(*arguments)
        self.assertEqual(len((programs / "calls").read_text().splitlines()), 2)
        shutil.rmtree(self.folder / "o" / "runs" / "07-city-poor-1-kys")
        self.call(*arguments)
        calls = (programs / "calls").read_text().splitlines()
        self.assertEqual(len(calls), 3)
        self.assertIn("--perception poor", calls[2])

    def test_interval_of_the_mean(self):
        """1, 2, ... 8: mean 4.5, standard error sqrt(6 / 8), t of 7 degrees of freedom 2.3646."""
        self.assertEqual(drive_tables.interval([float(v) for v in range(1, 9)]), "+4.500 +- 2.048")

    # --- perception ----------------------------------------------------------------------------

    def test_outputs_that_cannot_be_written(self):
        (self.folder / "a_pred.flo").touch()
        said = self.refused("perception/import_outputs.py", "unimatch-flow", self.folder, "--output",
                            "/dev/null/x")
        self.assertIn("/dev/null", said)

    def test_documents_that_are_no_predictions(self):
        document = self.folder / "predictions.json"
        info = '{"annotations": [{"file_name": "a.png", "segments_info": [{"id": %s, "category_id": 1}]}]}'
        for text in ("", "[" * 100000, "[1]", info % "Infinity", info % "NaN", info % "[]",
                     '{"annotations": [{"file_name": 5, "segments_info": []}]}'):
            document.write_text(text)
            said = self.refused("perception/import_outputs.py", "kmax", self.folder, "--json", document,
                                "--output", self.folder / "out")
            self.assertIn("predictions.json: not the document", said)

    def test_decision_page(self):
        for name in ("image_0", "image_1"):
            (self.folder / "sequence" / name).mkdir(parents=True)
        said = self.refused("perception/decision_page.py", self.segments.parent, self.folder / "sequence",
                            "--output", self.folder / "page.html")
        self.assertTrue("segments.csv: has no column" in said or "cv2" in said, said)

    def test_numbers_of_frames(self):
        done = self.call("perception/make_priors.py", self.folder, "--model", "x", "--output", "y",
                         "--frames", "-1")
        self.assertEqual(done.returncode, 2)
        self.assertIn("--frames", done.stderr)


if __name__ == "__main__":
    unittest.main()
