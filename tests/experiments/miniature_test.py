# SPDX-License-Identifier: BSD-3-Clause
"""tools/reproduce.sh in miniature: every experiment, its tables and figures, the report.

Interrupted once and resumed; then with data given: a folder that holds a part of a KITTI sequence, with its
perception outputs, and one that cannot be read.
"""
import csv
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("KYS_BUILD", SOURCE / "build" / "release"))
WORK = BUILD / "experiments" / "miniature"
CHROMIUM = next((p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if p),
                None)
try:
    import matplotlib  # noqa: F401
    import scipy  # noqa: F401
    import snakemake  # noqa: F401
    import yaml  # noqa: F401
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)


def command(output, *more):
    return [str(SOURCE / "tools" / "reproduce.sh"), "--miniature", "--no-setup", "--bin",
            str(BUILD / "bin"), "--output", str(output), "--cores", "2", *map(str, more)]


def environment():
    return {**os.environ, "KYS_PYTHON": sys.executable}


def reproduce(output, *more):
    done = subprocess.run(command(output, *more), capture_output=True, text=True, check=False,
                          env=environment())
    if done.returncode != 0:
        raise AssertionError(f"status {done.returncode}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}")
    return done.stdout + done.stderr


def interrupt_after(jobs, output):
    """Starts it, and stops it with Ctrl-C once some jobs are done; what is done then."""
    process = subprocess.Popen(command(output), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                               start_new_session=True, env=environment())
    finished = output / "done"
    while process.poll() is None and len(list(finished.glob("*.json"))) < jobs:
        time.sleep(0.1)
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGINT)
    process.wait()
    return {p.name: p.stat().st_mtime_ns for p in finished.glob("*.json")}


def rows(path):
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


class Miniature(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        shutil.rmtree(WORK, ignore_errors=True)
        cls.before = interrupt_after(6, WORK)
        reproduce(WORK)
        cls.plan = json.loads((WORK / "plan.json").read_text())
        cls.page = (WORK / "report.html").read_text()

    def test_what_was_done_before_an_interrupt_is_not_done_again(self):
        self.assertGreaterEqual(len(self.before), 6)
        again = [name for name, changed in self.before.items()
                 if (WORK / "done" / name).stat().st_mtime_ns != changed]
        # The jobs at work when it was stopped may have ended unnoticed: one per core.
        self.assertLessEqual(len(again), 2, again)

    def test_every_job_is_done(self):
        for ident in self.plan["jobs"]:
            result = json.loads((WORK / "done" / (ident + ".json")).read_text())
            self.assertIn(result["status"], ("done", "lost"), result)

    def test_every_experiment_has_its_tables(self):
        names = [e["name"] for e in self.plan["experiments"]]
        self.assertGreater(len(names), 8)
        for experiment in self.plan["experiments"]:
            name = experiment["name"]
            runs = rows(WORK / "tables" / f"{name}.runs.csv")
            self.assertEqual(len(runs), len(experiment["runs"]))
            for row in runs:
                if row["status"] == "done" and row["schedule"]:  # a survey runs nothing
                    self.assertGreater(float(row["ate"]), 0)
            for form in ("csv", "md", "tex"):
                self.assertTrue((WORK / "tables" / f"{name}-1.{form}").stat().st_size > 40)
            if "published" in experiment:
                self.assertTrue((WORK / "tables" / f"{name}-published.csv").exists())
            self.assertIn(f'id="{name}"', self.page)
        self.assertTrue(rows(WORK / "tables" / "summary.csv"))

    def test_the_report_is_one_file(self):
        self.assertNotRegex(self.page, r'(src|href)="(?!data:|#)')
        self.assertGreater(self.page.count("<img "), 10)
        for question in ("How accurate is it?", "Compared with whom?", "Do priors help, and when?",
                         "What does it cost?", "Is it reproducible?", "differs from the paper?"):
            self.assertIn(question, self.page)

    def browse(self, check, option):
        """The report in Chromium with a script added: the finished process, its page in stdout."""
        with tempfile.TemporaryDirectory() as folder:
            page = pathlib.Path(folder, "report.html")
            page.write_text(self.page.replace("</body>", check + "</body>"))
            return subprocess.run(
                [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder}/c",
                 option, "--virtual-time-budget=20000", "--dump-dom", f"file://{page}"],
                capture_output=True, text=True, check=True, timeout=120)

    @unittest.skipUnless(CHROMIUM, "no Chromium")
    def test_a_browser_shows_it_without_errors(self):
        check = ("<script>window.onload=()=>{const i=[...document.images];document.body.dataset.check="
                 "i.length+' '+i.filter(x=>x.naturalWidth<100).length+' '+"
                 "[...document.querySelectorAll('tbody')].filter(t=>!t.rows.length).length}</script>")
        done = self.browse(check, "--enable-logging=stderr")
        images, broken, empty = map(int, re.search(r'data-check="(\d+) (\d+) (\d+)"', done.stdout).groups())
        self.assertEqual(images, self.page.count("<img "))
        self.assertEqual(broken, 0, "broken pictures")
        self.assertEqual(empty, 0, "empty tables")
        self.assertNotIn("CONSOLE", done.stderr)

    @unittest.skipUnless(CHROMIUM, "no Chromium")
    def test_no_table_is_cut_at_1280_px(self):
        check = ("<script>window.onload=()=>{document.body.dataset.cut=[...document.querySelectorAll('table')]"
                 ".filter(t=>t.scrollWidth>t.clientWidth+1).map(t=>t.innerText.slice(0,40)).join('|')+'.'}"
                 "</script>")
        done = self.browse(check, "--window-size=1280,900")
        self.assertEqual(re.search(r'data-cut="([^"]*)"', done.stdout).group(1), ".")

    def test_given_data_is_found_and_marked_and_a_broken_folder_is_a_row(self):
        work = BUILD / "experiments" / "given"
        shutil.rmtree(work, ignore_errors=True)
        street = next(p for p in (WORK / "inputs").iterdir() if p.name.startswith("input-street"))
        sequences = work / "data" / "kitti" / "dataset" / "sequences"
        shutil.copytree(street, sequences / "00", ignore=shutil.ignore_patterns("README"))
        (sequences / "01" / "image_0").mkdir(parents=True)
        said = reproduce(work / "out", "--data", work / "data", "--only", "table_1_kitti")
        self.assertIn("found kitti/00 (16 of 4541 frames)", said)
        self.assertIn("left out kitti/01 (0 of 1101 frames) with priors", said)
        runs = rows(work / "out" / "tables" / "table_1_kitti.runs.csv")
        good = [r for r in runs if r["input"] == "kitti/00 (16 of 4541 frames)"]
        self.assertTrue(good and all(r["origin"] == "partial" and r["status"] == "done" for r in good), good)
        bad = [r for r in runs if r["input"].startswith("kitti/01 ")]
        self.assertTrue(bad and all(r["status"] == "failed" and r["reason"] for r in bad), bad)
        self.assertIn("calib.txt: no such file", bad[0]["reason"])
        table = (work / "out" / "tables" / "table_1_kitti-1.md").read_text()
        self.assertIn("parts of given sequences", table)
        self.assertNotIn("published, Table 1", table, "those are of whole sequences")


if __name__ == "__main__":
    unittest.main()
