# SPDX-License-Identifier: BSD-3-Clause
"""Steps and pages of the experiments, scripts around them, and what they refuse. No experiment is run."""
import contextlib
import io
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest
import unittest.mock

from experiment_code import SOURCE, touch

try:
    import lose_images
    import pages
    import prior_steps
    import report
    import step
    from tables import Table
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)


class Steps(unittest.TestCase):
    def run_step(self, job, done=None):
        with tempfile.TemporaryDirectory() as folder:
            work = pathlib.Path(folder)
            for name in ("jobs", "done"):
                (work / name).mkdir()
            (work / "plan.json").write_text(json.dumps(
                {"bin": folder, "source": str(SOURCE), "cores": 2, "jobs": [job["id"]],
                 "costs": [job["cost"]]}))
            (work / "jobs" / (job["id"] + ".json")).write_text(json.dumps(job))
            for name, result in (done or {}).items():
                (work / "done" / (name + ".json")).write_text(json.dumps(result))
            program = work / "simulate_sequence"
            program.write_text("#!/bin/sh\necho first >&2\necho 'simulate_sequence: no room' >&2\nexit 2\n")
            program.chmod(0o755)
            old, sys.argv = sys.argv, ["step.py", folder, job["id"]]
            quiet, sys.stdout = sys.stdout, open(os.devnull, "w", encoding="utf-8")
            try:
                self.assertEqual(step.main(), 0, "a failure is a result")
            finally:
                sys.stdout.close()
                sys.argv, sys.stdout = old, quiet
            return json.loads((work / "done" / (job["id"] + ".json")).read_text())

    def test_a_program_that_fails_is_a_row_with_its_last_line(self):
        result = self.run_step({"id": "input-x", "kind": "input", "needs": [], "threads": 2, "cost": 1,
                                "spec": {"arguments": ["street", "--seed", "1"]}})
        self.assertEqual(result["status"], "failed")
        self.assertEqual(result["reason"], "simulate_sequence: status 2: simulate_sequence: no room")

    def test_what_needs_a_failed_job_fails_with_its_reason(self):
        result = self.run_step({"id": "run-x", "kind": "run", "needs": ["priors-y"], "threads": 1,
                                "cost": 1, "spec": {}},
                               {"priors-y": {"status": "failed", "reason": "no file", "seconds": 1}})
        self.assertEqual(result, {**result, "status": "failed", "reason": "priors: no file"})

    def test_times_of_networks_per_frame(self):
        """Of both cameras: two images, two fields of disparity, four of flow per frame."""
        times = {"network": 3.0, "segments": 1.0, "segmented images": 20, "build": 7.0}
        self.assertEqual(prior_steps.network_times(times), {"segmentation_ms": 400.0})
        times.update({"stereo": 2.0, "stereo fields": 20, "flow": 9.0, "flow fields": 36})
        self.assertEqual(prior_steps.network_times(times), {"segmentation_ms": 400.0, "stereo_network_ms": 200.0,
                                                     "flow_network_ms": 1000.0})
        self.assertEqual(prior_steps.network_times({}), {})

    def test_estimates_take_the_place_of_both_disparities_and_flows(self):
        files = ["--label-space", "vkitti2", "--disparity", "l", "--disparity-right", "r",
                 "--flow-left", "fl", "--flow-right", "fr"]
        self.assertEqual(prior_steps.with_estimates(files, "sgbm", "dis"),
                         ["--label-space", "vkitti2", "--disparity", "sgbm", "--flow-left", "dis",
                          "--flow-right", "dis"])
        self.assertEqual(prior_steps.with_estimates(files, None, None), files)
        self.assertEqual(prior_steps.with_estimates(files, None, "dis"), files[:7] + ["dis", "--flow-right", "dis"])

    def test_the_rest_goes_on_like_what_was_done(self):
        with tempfile.TemporaryDirectory() as folder:
            work = pathlib.Path(folder)
            for name in ("jobs", "done"):
                (work / name).mkdir()
            ids = [f"run-{i:03}" for i in range(100)]
            (work / "plan.json").write_text(json.dumps(
                {"cores": 2, "jobs": ids, "costs": [20 if i % 2 else 10 for i in range(100)]}))
            for i in range(60):  # in half the time that was expected; of two threads the odd ones
                job = {"id": ids[i], "cost": 10, "threads": 1 + i % 2}
                (work / "jobs" / f"{ids[i]}.json").write_text(json.dumps(job))
                (work / "done" / f"{ids[i]}.json").write_text(json.dumps({"seconds": 5}))
            (work / "done" / "of-an-earlier-plan.json").write_text(json.dumps({"seconds": 1e6}))
            count, total, seconds = step.time_left(step.Work(folder))
            self.assertEqual((count, total), (60, 100))
            self.assertAlmostEqual(seconds, 0.5 * (20 * 10 + 20 * 20) / 2)


class Pages(unittest.TestCase):
    """Tables of a report go between their markers, with the version; others stay."""
    PAGE = "a\n\n<!-- table t-1 -->\nold\n<!-- end -->\n\nb\n\n<!-- table u -->\nkept\n<!-- end -->\n"
    TABLE = Table("t-1", "Title", ["x"], [["1"]], "A note.").markdown()

    def read(self, name):
        return self.TABLE if name == "t-1" else None

    def test_fill(self):
        text, count = pages.fill(self.PAGE, self.read, "abc")
        self.assertEqual(count, 1)
        self.assertEqual(text, "a\n\n<!-- table t-1 -->\n\n| x |\n| --- |\n| 1 |\n\nTitle. Version `abc`. A note.\n\n"
                               "<!-- end -->\n\nb\n\n<!-- table u -->\nkept\n<!-- end -->\n")
        self.assertEqual(pages.fill(text, self.read, "abc"), (text, 1), "once more changes nothing")

    def test_a_table_without_an_end_is_refused(self):
        with self.assertRaisesRegex(pages.InputError, "without"):
            pages.fill("<!-- table t-1 -->\nold\n", self.read, "abc")

    def test_command(self):
        with tempfile.TemporaryDirectory() as folder:
            work, page = pathlib.Path(folder), pathlib.Path(folder) / "page.md"
            (work / "tables").mkdir()
            (work / "tables" / "t-1.md").write_text(self.TABLE)
            page.write_text(self.PAGE)
            call = lambda: subprocess.run(
                [sys.executable, SOURCE / "tools" / "experiments" / "pages.py", work, page],
                capture_output=True, text=True, check=False)
            for plan_text, said in (("{}", "no plan"), ('{"version": ""}', "names no version")):
                (work / "plan.json").write_text(plan_text)
                done = call()
                self.assertEqual((done.returncode, page.read_text()), (2, self.PAGE))
                self.assertIn(said, done.stderr)
            (work / "plan.json").write_text('{"version": "abc"}')
            self.assertEqual(call().returncode, 0)
            self.assertEqual(page.read_text(), pages.fill(self.PAGE, self.read, "abc")[0])


class LostImages(unittest.TestCase):
    COUNT = 400

    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)
        self.sequence = self.folder / "sequence"
        for camera in lose_images.CAMERAS:
            for i in range(self.COUNT):
                touch(self.sequence / camera / f"{i:06d}.png")
                (self.sequence / camera / f"{i:06d}.png").write_text(f"{camera} {i}")
        for i in range(self.COUNT - 1):  # the last one has none
            touch(self.folder / "given" / f"{i:06d}.kysp")
            (self.folder / "given" / f"{i:06d}.kysp").write_text(f"priors {i}")
        (self.sequence / "times.txt").write_text("".join(f"{0.1 * i:.3f}\n" for i in range(self.COUNT)))
        (self.sequence / "poses.txt").write_text("".join(f"pose {i}\n" for i in range(self.COUNT)))
        (self.sequence / "calib.txt").write_text("P0: 1\n")

    def lose(self, name, missing, repeated, seed=1, late=0):
        return lose_images.lose(self.sequence, self.folder / name, self.folder / "given", seed, missing, repeated,
                                  late)

    def test_every_frame_has_its_time_and_what_belongs_to_its_picture(self):
        frames = self.lose("lost", 0.15, 0.1)
        place = self.folder / "lost"
        times = (place / "times.txt").read_text().split()
        poses = (place / "poses.txt").read_text().splitlines()
        self.assertEqual([len(times), len(poses), len(os.listdir(place / "image_1"))], [len(frames)] * 3)
        for k, (time, picture) in enumerate(frames):
            self.assertEqual(times[k], f"{0.1 * time:.3f}")
            self.assertEqual(poses[k], f"pose {picture}")
            for camera in lose_images.CAMERAS:
                self.assertEqual((place / camera / f"{k:06d}.png").read_text(), f"{camera} {picture}")
            if picture < self.COUNT - 1:
                self.assertEqual((place / "priors" / f"{k:06d}.kysp").read_text(), f"priors {picture}")

    def test_shares(self):
        frames = self.lose("lost", 0.15, 0.1)
        self.assertEqual(frames[:4], [(0, 0), (1, 1), (2, 2), (3, 3)])
        self.assertAlmostEqual(1 - len(frames) / self.COUNT, 0.15, delta=0.05)
        repeated = [(time, picture) for time, picture in frames if time != picture]
        self.assertAlmostEqual(len(repeated) / self.COUNT, 0.1, delta=0.05)
        for (_, before), (time, picture) in zip(frames, frames[1:]):
            self.assertIn(picture, (time, before), "a repeated picture is the one before")

    def test_seeds(self):
        first, again, other = (self.lose(name, 0.2, 0, seed) for name, seed in (("a", 1), ("b", 1), ("c", 2)))
        self.assertEqual(first, again)
        self.assertNotEqual(first, other)

    def test_stamps_are_late_by_at_most_their_share(self):
        self.assertEqual(len(self.lose("late", 0, 0, late=0.4)), self.COUNT)
        times = [float(t) for t in (self.folder / "late" / "times.txt").read_text().split()]
        delays = [time - 0.1 * i for i, time in enumerate(times)]
        self.assertGreaterEqual(min(delays), -1e-6)
        self.assertLessEqual(max(delays), 0.04 + 1e-6)
        self.assertAlmostEqual(sum(delays) / len(delays), 0.02, delta=0.002)

    def test_what_is_wrong_with_a_sequence_is_said(self):
        (self.sequence / "times.txt").write_text("0.0\n0.1\n")
        with self.assertRaisesRegex(lose_images.inputs.InputError, "times.txt: 2 lines for 400 images"):
            self.lose("lost", 0.1, 0)
        (self.sequence / "image_1" / "000007.png").unlink()
        with self.assertRaisesRegex(lose_images.inputs.InputError, "image_0 and image_1"):
            self.lose("lost", 0.1, 0)


class Refusals(unittest.TestCase):
    """One line and status 2."""

    def refused(self, script, *arguments):
        done = subprocess.run([sys.executable, SOURCE / "tools" / "experiments" / script, *arguments],
                              capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertNotIn("Traceback", done.stderr)
        return done.stderr.splitlines()[-1]

    def test_plans(self):
        with tempfile.TemporaryDirectory() as folder:
            program = pathlib.Path(folder) / "run_stereo_kitti"
            program.write_text("#!/bin/sh\necho '  mode: stock  # stock, verified'\n")
            program.chmod(0o755)
            plans = lambda *more: self.refused("plan.py", "--output", folder, "--bin", folder, *more)
            for cores in ("0", "-1", "x"):
                self.assertIn("--cores", plans("--cores", cores))
            self.assertIn("/nonexistent", plans("--worlds", "/nonexistent"))
            self.assertIn("--inputs nosuch", plans("--inputs", "nosuch", "--only", "table_3_rejection"))

    def test_damaged_work_folders(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "plan.json"
            for text in ("[]", "{}", "null", "{"):
                path.write_text(text)
                self.assertIn("plan.json", self.refused("report.py", folder))
                self.assertIn("plan.json", self.refused("step.py", folder, "x"))
            path.write_text(json.dumps({"cores": 1, "jobs": [], "costs": []}))
            self.assertIn("nosuch.json", self.refused("step.py", folder, "nosuch"))


class Reports(unittest.TestCase):
    def report(self, work, table):
        """status of report.py of a plan without experiments; `table`: makes its tables."""
        (work / "plan.json").write_text(json.dumps(
            {"scale": "full", "source": str(SOURCE), "jobs": [], "given": {}, "experiments": []}))
        with unittest.mock.patch.object(report, "first_page", table), \
                unittest.mock.patch.object(sys, "argv", ["report.py", str(work)]), \
                contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            return report.main()

    def test_old_tables_stay_until_there_are_new_ones(self):
        with tempfile.TemporaryDirectory() as folder:
            work = pathlib.Path(folder)
            touch(work / "tables" / "old.csv")
            self.assertEqual(self.report(work, unittest.mock.Mock(side_effect=OSError("no room"))), 2)
            self.assertTrue((work / "tables" / "old.csv").exists())
            tables = [Table("new", "New", ["a"], [["1"]])]
            self.assertEqual(self.report(work, lambda *_: ("", tables)), 0)
            self.assertEqual(sorted(os.listdir(work / "tables")), ["new.csv", "new.md", "new.tex"])
            self.assertEqual(sorted(os.listdir(work)), ["figures", "plan.json", "report.html", "tables"])


class Scripts(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)

    def program(self, name, text):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("#!/bin/sh\n" + text)
        path.chmod(0o755)
        return path

    def call(self, *command, **more):
        return subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False, **more)

    def test_lint_without_a_branch_to_compare_with(self):
        for tool in ("clang-format", "clang-tidy", "cmake"):
            self.program(f"bin/{tool}", "exit 0\n")
        shutil.copytree(SOURCE / "tools", self.folder / "source" / "tools",
                        ignore=lambda folder, names: [n for n in names if n != "lint.sh"])
        git = ("git", "-C", self.folder / "source", "-c", "user.name=a", "-c", "user.email=a")
        self.call(*git, "init", "-q", "-b", "other")
        self.call(*git, "commit", "-q", "--allow-empty", "-m", "first")
        path = f"{self.folder / 'bin'}:{os.environ['PATH']}"
        done = self.call(self.folder / "source" / "tools" / "lint.sh", env={**os.environ, "PATH": path})
        self.assertNotEqual(done.returncode, 0, done.stdout)
        self.assertIn("main", done.stderr)

    def test_setup_refuses_options_it_does_not_have(self):
        for options in (["--pyhton"], ["--python", "--view"]):
            done = self.call(SOURCE / "tools" / "setup.sh", *options, timeout=60)
            self.assertEqual((done.returncode, done.stderr.count("\n")), (2, 1), done.stderr)

    def test_reproduce_takes_paths_of_its_caller(self):
        """The interpreter is a stub that writes its arguments: those of plan.py."""
        self.program("python", 'printf "%s\\n" "$@" > seen; exit 3\n')
        for name in ("data", "bin", "worlds"):
            (self.folder / name).mkdir()
        done = self.call(SOURCE / "tools" / "reproduce.sh", "--no-setup", "--data", "data", "--bin", "bin",
                         "--output", "a b", "--worlds", "worlds", "--segment-model", "m.yaml",
                         "--segment-weights", "w.onnx", "--flow-model", "f.yaml", cwd=self.folder,
                         env={**os.environ, "KYS_PYTHON": "./python"})
        self.addCleanup((SOURCE / "seen").unlink)
        self.assertEqual(done.returncode, 3, done.stderr)
        words = (SOURCE / "seen").read_text().splitlines()
        for option, name in (("--data", "data"), ("--bin", "bin"), ("--output", "a b"),
                             ("--worlds", "worlds"), ("--segment-model", "m.yaml"),
                             ("--segment-weights", "w.onnx"), ("--flow-model", "f.yaml")):
            self.assertEqual(words[words.index(option) + 1], str(self.folder / name))

    def test_a_checkout_in_a_folder_with_a_space(self):
        """The workflow runs one job of a plan that was made."""
        tools = self.folder / "a b" / "experiments"
        shutil.copytree(SOURCE / "tools" / "experiments", tools,
                        ignore=shutil.ignore_patterns("__pycache__"))
        (tools / "step.py").write_text(
            "import sys\nopen(f'done/{sys.argv[2]}.json', 'w').write('{}')\n")
        work = self.folder / "work"
        for name in ("jobs", "done"):
            (work / name).mkdir(parents=True)
        (work / "plan.json").write_text(json.dumps({"jobs": ["x"]}))
        (work / "jobs" / "x.json").write_text(json.dumps({"needs": [], "threads": 1, "cost": 1}))
        done = self.call(sys.executable, "-m", "snakemake", "--snakefile", tools / "Snakefile",
                         "--directory", work, "--cores", "1", "--quiet", "all")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue((work / "done" / "x.json").exists())


if __name__ == "__main__":
    unittest.main()
