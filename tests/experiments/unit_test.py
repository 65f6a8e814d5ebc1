# SPDX-License-Identifier: BSD-3-Clause
"""Parts of the experiments workflow, without running any experiment."""
import argparse
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

SOURCE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(SOURCE / "tools" / "experiments"))
try:
    import numpy as np

    import data_sets
    import drives
    import experiment_tables
    import figures
    import first_page
    import forest
    import lose_images
    import networks
    import pages
    import paired
    import plan
    import prior_steps
    import report
    import results
    import step
    import survey_steps
    import town_path
    import drive_tables  # runs knows where inputs is
    from tables import Table, show
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)


def touch(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("")


class Published(unittest.TestCase):
    """The figures as copied from the paper agree with what the paper says of them."""

    def values(self, name, method, metric="ate"):
        return {r["sequence"]: r["value"] for r in results.published(name)
                if r["method"] == method and r["metric"] == metric}

    def test_every_row_has_a_source(self):
        for path in (SOURCE / "tools" / "experiments" / "published").glob("*.csv"):
            for row in results.published(path.name):
                self.assertTrue(row["source"] and row["section"] and row["unit"], f"{path}: {row}")

    def test_mean_reductions_of_table_1_follow_from_its_values(self):
        base = self.values("table1.csv", "ORB-SLAM3")
        self.assertEqual(len(base), 11)
        for method, reduction in (("KYS-SLAM", 17.4), ("+Pano", 16.6), ("+Sem", 9.5),
                                  ("DynaSLAM", 11.7), ("Semantic I", -2.1), ("ORB-SLAM2", -0.6)):
            mine = self.values("table1.csv", method)
            mean = np.mean([100 * (base[s] - mine[s]) / base[s] for s in base])
            self.assertAlmostEqual(mean, reduction, delta=0.3, msg=method)

    def test_means_of_table_2_follow_from_its_values(self):
        for method in ("ORB-SLAM3", "+Sem", "+Pano", "KYS-SLAM", "SVO", "DVI-SLAM"):
            stated = self.values("table2.csv", method, "ATE, mean over sequences")[""]
            mean = np.mean(list(self.values("table2.csv", method).values()))
            self.assertAlmostEqual(mean, stated, delta=0.0006, msg=method)

    def test_published_figures_stand_below_those_of_the_same_metric(self):
        for name, metric, line in (
                ("table_s7_stall", "wall clock",
                 ["ORB-SLAM3 stall 0 ms", "94.40", "34.60", "126.00", "138.10"]),
                ("table_s7_stall", "ATE", ["ORB-SLAM3 stall 50 ms", "1.310", "0.270", "0.910", "1.320"]),
                ("table_supp_e_f_h", "keypoints with mu up to 8",
                 ["KYS-SLAM gate 8", "99.80", "93.80", "73.40"])):
            experiment = {**plan.load_yaml(name + ".yaml"), "name": name}
            rows = [{"input": i, "seed": 1, "case": "exact", "variant": "", "schedule": "realtime", "repeat": 0,
                     "origin": "given", "configuration": experiment["baseline"], "status": "done", "tracked": 100.0,
                     **dict.fromkeys(experiment["metrics"], 1.0)} for i in experiment["inputs"]]
            table, = (t for t in experiment_tables.value_tables(experiment, rows) if f": {metric}," in t.title)
            self.assertIn(line, [row[:len(line)] for row in table.rows], name)


class Statistics(unittest.TestCase):
    def test_a_clear_difference(self):
        base = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
        d = paired.difference(base, [b - 0.5 - 0.01 * b for b in base])
        self.assertAlmostEqual(d.mean, -0.535)
        self.assertLess(d.high, 0)
        self.assertEqual(d.verdict, "smaller")
        self.assertAlmostEqual(d.wilcoxon_p, 2 / 2**6)  # all signs alike: two of 64 orders

    def test_none_where_there_is_none(self):
        d = paired.difference([1] * 6, [1.1, 0.9, 1.2, 0.8, 1.3, 0.7])
        self.assertLess(d.low, 0)
        self.assertGreater(d.high, 0)
        self.assertEqual(d.verdict, "no difference shown")
        self.assertEqual(paired.difference([1] * 6, [1] * 6).verdict, "no difference shown")

    def test_an_interval_that_includes_no_change_and_is_wide_decides_nothing(self):
        logs = np.log([4, 1 / 4, 3, 1 / 3, 2, 1 / 2])
        self.assertEqual(paired.difference(np.zeros(6), logs).verdict, "too wide to say")
        self.assertEqual(paired.difference(np.zeros(6), logs / 20).verdict, "no difference shown")

    def test_five_pairs_have_an_interval_and_no_verdict(self):
        d = paired.difference([1] * 5, [0.5, 0.6, 0.5, 0.4, 0.5])
        self.assertLess(d.high, 0)
        self.assertIsNone(d.wilcoxon_p, "five pairs cannot show anything")
        self.assertEqual(d.verdict, "too wide to say")

    def test_where_there_is_no_difference_few_verdicts_say_one(self):
        random = np.random.default_rng(5)
        for pairs in (3, 6, 8, 10):
            found = [paired.difference(np.zeros(pairs), random.normal(size=pairs)).verdict
                     for _ in range(200)]
            wrong = sum(v in ("smaller", "larger") for v in found) / len(found)
            self.assertLess(wrong, 0.08, pairs)

    def test_two_pairs_say_nothing(self):
        self.assertEqual(paired.difference([1, 1], [0.1, 0.1]).verdict, "too wide to say")
        self.assertEqual(paired.difference([], []).pairs, 0)

    def test_the_same_numbers_give_the_same_interval(self):
        a, b = [1, 2, 3, 4], [1.5, 2.1, 2.5, 4.4]
        self.assertEqual(paired.difference(a, b), paired.difference(a, b))

    def test_pairs_are_of_the_same_input_seed_and_case(self):
        row = lambda name, seed, ate, repeat=0: {
            "input": name, "seed": seed, "case": "exact", "variant": "", "schedule": "pipelined",
            "repeat": repeat, "ate": ate}
        base = [row("a", 1, 1.0), row("a", 2, 2.0), row("b", 1, 4.0), row("b", 2, None)]
        mine = [row("a", 1, 3.0), row("a", 1, 5.0, 1), row("b", 1, 1.0), row("b", 2, 9.0)]
        base += [row("c", 1, None), {**row("c", 2, None), "status": "failed"}, row("c", 3, 1.0)]
        mine += [row("c", 1, None), {**row("c", 2, None), "status": "lost"}, row("c", 4, None)]
        base.append(row("d", 1, 1.0))
        mine += [row("a", 2, None), {**row("d", 1, None), "status": "missing"}]
        found = results.pairs(base, mine, "ate")
        self.assertEqual([k[:2] for k in found.keys], [("a", 1), ("b", 1)])
        self.assertEqual((found.baseline, found.values), ([1.0, 4.0], [4.0, 1.0]))  # repeats are averaged
        self.assertEqual([k[:2] for k in found.lost], [("c", 2), ("a", 2)])
        self.assertEqual([k[:2] for k in found.lost_baseline], [("b", 2), ("c", 2)])

    def crashes(self):
        """stock does all of eight seeds, KYS six of them, twice as well; two origins."""
        rows = []
        for origin, factor in (("substitute", 0.5), ("simulated", 2.0)):
            for seed in range(1, 9):
                labels = {"input": origin, "seed": seed, "case": "exact", "variant": "", "repeat": 0,
                          "schedule": "pipelined", "origin": origin, "what": origin, "status": "done"}
                rows.append({**labels, "configuration": "stock", "ate": 1.0 * seed, "tracked": 100.0})
                rows.append({**labels, "configuration": "KYS", "ate": factor * seed, "tracked": 100.0})
        for row, status in zip((rows[1], rows[3]), ("failed", "lost")):
            row.update(status=status, ate=None, tracked=0.0)
        return rows

    def test_runs_without_a_result_are_said(self):
        rows = self.crashes()
        experiment = {"name": "t", "title": "T", "paper": "", "baseline": "stock"}
        substitutes, worlds = first_page.pooled([(experiment, rows)])
        self.assertEqual(substitutes.about, "6 pairs, 2 without result (stock 0); tracked 75.0 % (stock 100.0 %)")
        self.assertEqual(worlds.about, "8 pairs")
        self.assertEqual([(r.group, r.label, r.verdict) for r in (substitutes, worlds)],
                         [("simulated substitutes", "KYS", "smaller"), ("simulated worlds", "KYS", "larger")])
        for row, ratio in ((substitutes, 0.5), (worlds, 2.0)):
            self.assertAlmostEqual(row.ratio, ratio)
            self.assertAlmostEqual(row.low, ratio)
            self.assertAlmostEqual(row.high, ratio)
        said = first_page.helps_in_words([substitutes, worlds], first_page.where([(experiment, rows)]))
        self.assertIn("smaller 1, larger 1, no difference shown 0, too wide to say 0", said)
        column = lambda table, name: [r[table.header.index(name)] for r in table.rows]
        lost = experiment_tables.WITHOUT
        summary = first_page.helps(None, [(experiment, rows)])
        self.assertEqual(column(summary, lost), ["2 (0)", "0 (0)"])
        self.assertEqual(column(summary, "ratio"), ["0.500", "2.000"])
        self.assertEqual(column(summary, "verdict"), ["smaller", "larger"])
        where = first_page.where([(experiment, rows)])
        self.assertEqual(column(where, lost), ["2 (0)", "0 (0)"])
        self.assertEqual(column(where, "KYS, tracked %"), ["75.0", "100.0"])
        paired_table = experiment_tables.paired_tables(experiment, rows)[0]
        self.assertEqual(column(paired_table, lost), ["2 (0)"])
        self.assertEqual(column(paired_table, "tracked %"), ["75.0"])

    def test_a_configuration_that_never_has_a_result_is_a_row(self):
        rows = [r if r["configuration"] == "stock" else {**r, "status": "failed", "ate": None, "tracked": 0.0}
                for r in self.crashes() if r["origin"] == "simulated"]
        row = dict(zip(experiment_tables.PAIRED_HEADER, experiment_tables.paired_rows(
            [], results.select(rows, configuration="stock"), results.select(rows, configuration="KYS"),
            "ate")))
        self.assertEqual((row["pairs"], row[experiment_tables.WITHOUT], row["tracked %"]),
                         (0, "8 (0)", "0.0"))
        row, = first_page.pooled([({"name": "t"}, rows)])
        self.assertEqual((row.ratio, row.verdict), (None, "too wide to say"))
        self.assertEqual(row.about, "0 pairs, 8 without result (stock 0); tracked 0.0 % (stock 100.0 %)")
        self.assertIn("KYS</span>", forest.forest([row]))
        first_page.where([({"name": "t"}, rows)])

    def test_a_reason_of_many_runs_is_said_once(self):
        row = lambda seed, status, reason: {"input": f"i{seed % 9}", "configuration": "KYS", "case": "exact",
                                            "status": status, "reason": reason}
        text = report.failures([row(s, "failed", "calib.txt: <none>") for s in range(20)]
                               + [row(1, "lost", "dark"), row(2, "done", "")])
        self.assertEqual(text.count("calib.txt: &lt;none&gt;"), 1)
        self.assertLess(text.index("20 failed: calib.txt"), text.index("1 lost: dark"))
        self.assertIn("i0, KYS, exact; i1, KYS, exact", text)
        self.assertIn("; and 3 more", text)  # nine inputs, six are named
        self.assertEqual(report.failures([row(1, "done", "")]), "")

    def test_what_failed_tracked_nothing(self):
        with tempfile.TemporaryDirectory() as folder:
            work = pathlib.Path(folder)
            touch(work / "done" / "x.json")
            (work / "done" / "x.json").write_text(json.dumps({"status": "failed", "reason": "no room"}))
            (work / "plan.json").write_text(json.dumps(
                {"scale": "full", "source": "", "jobs": [], "given": {}, "experiments": []}))
            labels = [{"job": "x"}, {"job": "not run yet"}]
            rows = results.Results(folder).rows({"runs": labels})
        self.assertEqual([r.get("tracked") for r in rows], [0.0, None])

    def test_the_best_other_is_compared_on_the_same_seeds(self):
        """verified fails on the hard seed: its mean is not one over easy seeds alone."""
        row = lambda configuration, seed, ate: {
            "input": "a", "seed": seed, "case": "exact", "variant": "", "schedule": "pipelined", "repeat": 0,
            "configuration": configuration, "ate": ate, "tracked": 100.0 if ate else 0.0,
            "status": "done" if ate else "failed"}
        rows = [row("stock", 1, 0.1), row("stock", 2, 9.0), row("verified", 1, 0.2), row("verified", 2, None)]
        self.assertEqual(experiment_tables.best_row(rows), ["0.2000", "stock", "0.1000", "NO", "50.0", "1 (0)"])
        rows[2] = row("verified", 1, None)
        self.assertEqual(experiment_tables.best_row(rows), ["-", "stock", "-", "NO", "0.0", "2 (0)"])

    def test_verified_over_the_others_by_exact_and_wrong_priors(self):
        row = lambda configuration, case, seed, ate: {
            "input": "world/a", "seed": seed, "case": case, "variant": "matches", "schedule": "pipelined",
            "repeat": 0, "configuration": configuration, "ate": ate, "tracked": 100.0}
        rows = []
        for seed in range(1, 7):
            rows += [row("mask", "exact", seed, 1.0), row("verified", "exact", seed, 1.0 + (seed - 1) % 3),
                     row("mask", "late", seed, 4.0), row("verified", "late", seed, 1.0),
                     row("mask", "flip", seed, 1.0), row("verified", "flip", seed, 1.0)]
        table = experiment_tables.wrong_prior_table({"name": "study"}, rows)
        exact, wrong = table.rows
        # exact: geometric mean of 1, 2, 3; wrong: of 1/4 and 1 for every seed
        self.assertEqual(exact[2:6], ["exact", "mask", 6, "1.8"])
        self.assertEqual(wrong[2:7], ["wrong", "mask", 6, "0.5", "0.5 to 0.5"])
        self.assertEqual(wrong[8], "smaller")


    def test_schedules_are_not_pooled_when_variants_are_compared(self):
        row = lambda variant, schedule, seed, ate: {
            "input": "a", "seed": seed, "case": "exact", "variant": variant, "schedule": schedule,
            "repeat": 0, "origin": "substitute", "configuration": "KYS", "ate": ate, "tracked": 100.0}
        rows = [row(variant, schedule, seed, ate * seed) for seed in (1, 2, 3)
                for schedule in ("pipelined", "realtime")
                for variant, ate in (("matches", 2.0), ("image area", 1.0))]
        tables = experiment_tables.variant_tables({"name": "t", "per": ["input", "variant"]}, rows)
        self.assertEqual([t.rows[0][2] for t in tables], [3, 3])  # pairs: seeds
        self.assertTrue("pipelined" in tables[0].title and "realtime" in tables[1].title)

    def test_p_belongs_to_the_ratio_beside_it(self):
        """Ratios of one half, but for one pair whose metres outweigh the others'."""
        row = lambda seed, ate: {"input": "a", "seed": seed, "case": "exact", "variant": "",
                                 "schedule": "pipelined", "repeat": 0, "ate": ate, "tracked": 100.0}
        base = [row(s, 0.1 * s) for s in range(1, 8)] + [row(8, 100.0)]
        mine = [row(s, 0.05 * s) for s in range(1, 8)] + [row(8, 101.0)]
        shown = dict(zip(experiment_tables.PAIRED_HEADER,
                         experiment_tables.paired_rows([], base, mine, "ate")))
        logs = paired.difference(np.zeros(8), [-np.log(2)] * 7 + [np.log(1.01)])
        self.assertEqual(shown["Wilcoxon p"], experiment_tables.show_p(logs.wilcoxon_p))

    def test_loops_of_a_run_with_a_revisit(self):
        row = {"origin": "given", "configuration": "KYS", "variant": "", "loops_closed": 2, "loops_true": 1,
               "revisits": 1, "revisits_joined": 1}
        still = {**row, "revisits": 0}
        table, = experiment_tables.loop_tables({"name": "t"}, [row, still, {"origin": "given"}])
        self.assertEqual(table.rows, [["given data", "KYS", "", 1, 2, 1, 1, 1]])
        self.assertIn("revisits_joined", experiment_tables.RUN_COLUMNS)

    def test_runs_that_are_far_off(self):
        """Of four runs one is within 1 m, two are not, one has no result."""
        row = {"input": "world/traffic", "variant": "", "configuration": "KYS", "tracked": 90.0}
        rows = [{**row, "ate": ate, "status": "done"} for ate in (0.5, 1.5, 9.0)]
        rows.append({**row, "status": "failed", "reason": "x"})
        table = experiment_tables.far_table({"name": "s"}, rows)
        self.assertEqual(table.rows, [["world/traffic", "KYS", 4, 2, 1, "1.500", "9.000", "90.0"]])
        self.assertNotIn("variant", table.header, "all are of one")

    def test_percentile_of_exposure(self):
        """Wrong keypoints in 1 to 20 % of 20 frames: 19.05 by linear interpolation."""
        def call(command):
            with open(command[-1], "w", encoding="utf-8") as file:
                file.write("frame,keypoints,any\n" + "".join(f"{i},100,{i}\n" for i in range(1, 21)))
        work = argparse.Namespace(program=lambda name: name)
        with tempfile.TemporaryDirectory() as folder, \
                unittest.mock.patch.object(prior_steps, "call", call):
            found = prior_steps.exposure(work, "", "", "", folder)
        self.assertAlmostEqual(found["exposure_p95"], 19.05)
        self.assertAlmostEqual(found["exposure_mean"], 10.5)
        self.assertEqual(found["exposure_max"], 20)


class ForestPlot(unittest.TestCase):
    rows = [forest.Row("a", "x <", 0.1, 0.05, 0.2, "smaller", "6 pairs"),
            forest.Row("a", "y", 1.0, 0.5, 2.0, "too wide to say", "6 pairs"),
            forest.Row("b", "z", None, None, None, "too wide to say", "0 pairs")]

    def test_the_axis_holds_all_values_and_1(self):
        self.assertEqual(forest.axis_of(self.rows), (0.05, 2))
        self.assertEqual(forest.axis_of([]), (0.5, 2))
        self.assertEqual(forest.ticks_of(0.01, 10), [0.01, 0.1, 1, 10])
        self.assertEqual(forest.ticks_of(0.5, 2), [0.5, 1, 2])

    def test_places_are_logarithmic(self):
        text = forest.forest([forest.Row("", "x", 0.1, 0.01, 1.0, "smaller", ""),
                              forest.Row("", "y", 10.0, None, None, "too wide to say", "")])
        self.assertIn('class="interval" style="left:0.00%;width:66.67%"', text)  # axis 0.01 to 10
        self.assertIn('class="ratio" style="left:33.33%"', text)
        self.assertIn('class="ratio" style="left:100.00%"', text)
        self.assertIn("0.1 (0.01 to 1)", text)

    def test_every_row_is_there_under_its_group(self):
        text = forest.forest(self.rows)
        self.assertEqual(text.count('class="group"'), 2)
        self.assertIn("x &lt;", text)
        self.assertEqual((text.count("row smaller"), text.count("row open")), (1, 2))


class Tables(unittest.TestCase):
    table = Table("t", "A & B", ["name", "x|y", "50 %"], [["a_b", "1", "<2>"], ["c", "-", "3"]],
                  "Note.", {1: "others"})

    def test_every_form_has_every_cell_and_is_escaped(self):
        self.assertIn("| a_b | 1 | <2> |", self.table.markdown())
        self.assertIn("x\\|y", self.table.markdown())
        self.assertEqual(self.table.comma_separated().splitlines()[1], "a_b,1,<2>")
        self.assertIn(r"a\_b & 1 & <2> \\", self.table.latex())
        self.assertIn(r"A \& B", self.table.latex())
        self.assertIn("<td>&lt;2&gt;</td>", self.table.html())
        self.assertIn('<td colspan="3">others</td>', self.table.html())

    def test_numbers(self):
        self.assertEqual([show(v) for v in (None, 0.01234567, 1.23456, 23.456789, 3, "x")],
                         ["-", "0.0123", "1.235", "23.46", "3", "x"])


class DataSets(unittest.TestCase):
    def test_usual_layouts_are_found_anywhere(self):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            touch(root / "kitti" / "dataset" / "sequences" / "07" / "image_0" / "000000.png")
            touch(root / "kitti" / "dataset" / "sequences" / "notes" / "x.txt")
            touch(root / "tracking" / "training" / "image_02" / "0001" / "000000.png")
            touch(root / "EuRoC" / "V1_01_easy" / "mav0" / "cam0" / "data.csv")
            touch(root / "EuRoC" / "machine_hall" / "MH_04_difficult" / "mav0" / "cam0" / "data.csv")
            touch(root / "vkitti_2.0.3_rgb" / "Scene18" / "clone" / "frames" / "x.txt")
            touch(root / "vkitti_2.0.3_rgb" / "Scene18" / "rain" / "frames" / "x.txt")
            found = data_sets.find(folder)
        self.assertEqual(sorted(found), ["euroc/MH04", "euroc/V101", "kitti/07", "tracking/0001",
                                         "vkitti/Scene18"])
        self.assertEqual(found["vkitti/Scene18"].label_space, "vkitti2")

    def test_recorded_trajectories_are_found_by_their_folders(self):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for name in ("dataset/poses/05.txt", "ground_truth/kitti/07.txt",
                         "ground_truth/euroc/V1_02_medium.tum.txt", "dataset/poses/notes.txt",
                         "other/05.txt"):
                touch(root / name)
            found = data_sets.find_trajectories(folder)
            self.assertEqual({k: os.path.relpath(v, folder) for k, v in found.items()},
                             {"kitti/05": "dataset/poses/05.txt",
                              "kitti/07": "ground_truth/kitti/07.txt",
                              "euroc/V102": "ground_truth/euroc/V1_02_medium.tum.txt"})

    def test_files_beside_a_sequence_are_a_part_of_its_state(self):
        """Ground truth of KITTI odometry; all but the left images of KITTI tracking."""
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            touch(root / "dataset" / "sequences" / "07" / "image_0" / "000000.png")
            touch(root / "training" / "image_02" / "0001" / "000000.png")
            states = lambda: {name: data_sets.state_of(*sequence.places)
                              for name, sequence in data_sets.find(folder).items()}
            before = states()
            for name, file in (("kitti/07", "dataset/poses/07.txt"),
                               ("tracking/0001", "training/image_03/0001/000000.png"),
                               ("tracking/0001", "training/calib/0001.txt"),
                               ("tracking/0001", "training/oxts/0001.txt")):
                for content in ("", "other"):
                    touch(root / file)
                    (root / file).write_text(content)
                    now = states()
                    self.assertEqual([n for n in now if now[n] != before[n]], [name], file)
                    before = now
            touch(root / "dataset" / "poses" / "08.txt")
            self.assertEqual(states(), before)

    def test_perception_beside_a_sequence(self):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            sequence = data_sets.Sequence("kitti/07", str(root / "sequences" / "07"))
            touch(root / "sequences" / "07" / "image_0" / "x.png")
            self.assertIsNone(data_sets.perception_of(sequence, folder))
            touch(root / "sequences" / "07" / "panoptic_left" / "x.png")
            touch(root / "sequences" / "07" / "panoptic_right" / "x.png")
            self.assertEqual(data_sets.perception_of(sequence, folder),
                             ("perception", sequence.folder))
            self.assertIsNone(data_sets.prior_files_of(sequence, folder))
            touch(root / "priors" / "kitti" / "07" / "000000.kysp")
            self.assertEqual(data_sets.prior_files_of(sequence, folder), str(root / "priors" / "kitti" / "07"))
            self.assertEqual(data_sets.perception_of(sequence, folder), ("perception", sequence.folder))


class Experiments(unittest.TestCase):
    def test_every_file_names_configurations_cases_and_inputs_that_exist(self):
        configurations = plan.load_yaml("configurations.yaml")
        cases, substitutes = plan.load_yaml("cases.yaml"), plan.load_yaml("substitutes.yaml")
        folder = SOURCE / "configs" / "experiments"
        files = sorted(p.name for p in folder.glob("*_*.yaml") if p.name != "substitutes.yaml")
        self.assertGreater(len(files), 8)
        for name in files:
            for spec in (e := plan.load_yaml(name), {**e, **e.get("quick", {})}):
                self.assertLessEqual(set(spec["configurations"]), set(configurations), name)
                self.assertLessEqual(set(spec.get("cases", [])), set(cases), name)
                for given in spec["inputs"]:
                    self.assertTrue(given.startswith(("world/", "drive/")) or given in substitutes, given)
                self.assertIn(spec["baseline"], spec["configurations"], name)
                self.assertIn("input", [spec["rows"], spec["columns"], *spec.get("per", [])], name)
                if "published" in spec:
                    self.assertTrue(results.published(spec["published"]))
        for entry in configurations.values():
            for key in ("config", "priors"):
                if key in entry:
                    self.assertTrue((SOURCE / "configs" / entry[key]).exists(), entry)


class Plans(unittest.TestCase):
    class Planner(plan.Planner):
        """Knows every setting; its runs are what they are made of."""
        def __init__(self, **options):
            self.options = argparse.Namespace(**{
                "scale": "full", "inputs": [], "seeds": [], "schedules": [], **options})

        def known(self, settings):
            return settings

        def run_of(self, source, name, configuration, settings, case, schedule, repeat, seed, _):
            return f"{name} {seed} {schedule} {repeat}"

    def test_other_prior_files_are_another_input(self):
        """Given data: their folder keeps its name, a file in it changes."""
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            touch(root / "kitti" / "07" / "image_0" / "000000.png")
            prior = root / "priors" / "kitti" / "07" / "000000.kysp"
            touch(prior)

            def ids():
                planner = self.Planner(data=folder)
                planner.jobs, planner.states, planner.cases = {}, {}, {"exact": {}}
                planner.given = data_sets.find(folder)
                planner.programs = unittest.mock.Mock(key=lambda name: name)
                source = planner.input_of("kitti/07", 1, {"seeds": [1]})
                return planner.priors_of(source, "kitti/07", "exact", None, 1)

            first = ids()
            self.assertEqual(ids(), first)
            time = prior.stat().st_mtime_ns
            prior.write_text("other")
            os.utime(prior, ns=(time, time - 10**9))  # as of an older archive
            self.assertNotEqual(ids(), first)

    def test_runs_without_some_pictures_have_priors_of_the_others(self):
        planner = plan.Planner.__new__(plan.Planner)
        planner.options = argparse.Namespace(scale="full", cores=2)
        planner.given, planner.jobs = {}, {}
        planner.cases = plan.load_yaml("cases.yaml")
        planner.programs = unittest.mock.Mock(key=lambda program: program)
        experiment = {"seeds": [1], "frames": 60}

        def job_of(mode, case):
            source = planner.input_of("world/street", 1, experiment)
            ident = planner.run_of(source, "world/street", {"mode": mode, "name": mode}, [], case, "pipelined", 0, 1,
                                   experiment)
            return planner.jobs[ident]

        run = job_of("kys", "missing 15 %")
        lost = planner.jobs[run["needs"][0]]
        self.assertEqual(run["spec"]["input"], f"inputs/{lost['id']}")
        self.assertEqual(run["spec"]["priors"], lost["id"])
        self.assertEqual(planner.jobs[lost["spec"]["priors"]]["spec"]["case"], {}, "of exact perception")
        stock = job_of("stock", "missing 15 %")
        self.assertIsNone(stock["spec"]["priors"])
        self.assertIsNone(planner.jobs[stock["needs"][0]]["spec"]["priors"])
        whole = job_of("kys", "exact")
        self.assertEqual(whole["spec"]["input"], lost["spec"]["input"], "pictures of the same world")
        self.assertEqual(whole["spec"]["priors"], lost["spec"]["priors"])

    def test_prior_files_whose_exposure_is_measured_depend_on_what_measures_it(self):
        def job(case, version):
            planner = self.Planner()
            planner.jobs, planner.given, planner.cases = {}, {}, plan.load_yaml("cases.yaml")
            planner.programs = unittest.mock.Mock(
                key=lambda name: f"{name} {version}" if name == "compare_priors" else name)
            source = planner.input_of("world/street", 1, {"seeds": [1]})
            return planner.priors_of(source, "world/street", case, None, 1)

        for case, depends in (("segments 10 %", True), ("flow 2.7 px", True), ("exact", False), ("drop", False),
                              ("sgbm+dis", False)):
            self.assertEqual(job(case, 1) != job(case, 2), depends, case)

    def test_other_code_of_the_steps_makes_other_jobs(self):
        with tempfile.TemporaryDirectory() as folder:
            code = pathlib.Path(folder) / "step.py"
            ids = set()
            with unittest.mock.patch.object(plan, "STEP", [str(code)]):
                for text in ("a", "b", "b"):
                    code.write_text(text)
                    plan.code_of_step.cache_clear()
                    planner = self.Planner()
                    planner.jobs = {}
                    ids.add(planner.add("run", ["x"], {}, [], 1, 1))
            plan.code_of_step.cache_clear()
            self.assertEqual(len(ids), 2)

    def test_what_does_a_job_is_a_part_of_its_id(self):
        """Modules of this repository that step.py loads or starts."""
        loaded = subprocess.run(
            [sys.executable, "-c", "import sys; sys.path.insert(0, sys.argv[1]); import step\n"
             "print(*[m.__file__ for m in sys.modules.values() if getattr(m, '__file__', None)], sep='\\n')",
             str(SOURCE / "tools" / "experiments")], capture_output=True, text=True, check=True)
        ours = {os.path.realpath(p) for p in loaded.stdout.splitlines()}
        ours = {p for p in ours if p.startswith(str(SOURCE) + os.sep) and ".venv" not in p}
        self.assertLessEqual(ours - {str(SOURCE / "tools" / "common" / "inputs.py")},
                             {os.path.realpath(p) for p in plan.STEP})

    def test_failed_jobs_are_done_again(self):
        with tempfile.TemporaryDirectory() as folder:
            done = pathlib.Path(folder) / "done"
            done.mkdir()
            for name, status in (("a", "failed"), ("b", "done"), ("c", "lost")):
                (done / f"{name}.json").write_text(json.dumps({"status": status}))
            plan.write_plan({}, {}, folder)
            self.assertEqual(sorted(p.stem for p in done.iterdir()), ["b", "c"])

    EXPERIMENT = {"seeds": [4, 5], "schedules": ["pipelined", "realtime"], "repeats": {"realtime": 2}}

    def runs(self, experiment, seed):
        rows = self.Planner().runs_of_input(experiment, ("input-x", "", {}), "x", seed,
                                            {"name": "stock", "mode": "stock", "settings": []})
        return [row["job"] for row in rows]

    def test_runs_that_are_repeated_are_of_the_first_seed(self):
        self.assertEqual(self.runs(self.EXPERIMENT, 4),
                         ["x 4 pipelined 0", "x 4 realtime 0", "x 4 realtime 1"])
        self.assertEqual(self.runs(self.EXPERIMENT, 5), ["x 5 pipelined 0"])

    def test_no_input_is_simulated_that_no_run_needs(self):
        asked = []
        planner = self.Planner()
        planner.configurations_of = lambda experiment: []
        planner.has_trajectory = lambda experiment, name: True
        planner.input_of = lambda name, seed, experiment: asked.append(seed) or (None, "", {})
        planner.runs_of({**self.EXPERIMENT, "inputs": ["x"]})
        self.assertEqual(asked, [4, 5])
        asked.clear()
        planner.runs_of({**self.EXPERIMENT, "inputs": ["x"], "schedules": ["realtime"]})
        self.assertEqual(asked, [4])

    def test_schedules_are_chosen(self):
        self.assertEqual(self.Planner().experiment("table_1_kitti.yaml")["schedules"],
                         ["pipelined", "realtime"])
        planner = self.Planner(schedules=["pipelined"])
        self.assertEqual(planner.experiment("table_1_kitti.yaml")["schedules"], ["pipelined"])
        self.assertEqual(planner.experiment("table_s7_stall.yaml")["schedules"], [])


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

    def test_worlds_rendered_before_are_known_by_their_command(self):
        """READMEs as simulate_sequence writes them, and the options a plan asks for."""
        with tempfile.TemporaryDirectory() as folder:
            for name, options in (("a", "--seed 1 --frames 60 --size 414x126"),
                                  ("b", "--seed 1 --size 414x126 --images-only"),
                                  ("c", "--seed 1 --size 414x126"), ("d", "--seed 2 --size 414x126")):
                touch(pathlib.Path(folder) / name / "README")
                (pathlib.Path(folder) / name / "README").write_text(
                    "A simulated sequence: world street, 200 frames. Made by\n\n"
                    f"    simulate_sequence street --output /elsewhere/{name} {options}\n\nimage_0  left image\n")
            touch(pathlib.Path(folder) / "e" / "notes")

            def found(name, frames=None):
                planner = Plans.Planner(scale="full")
                planner.given, planner.jobs = {}, {}
                planner.programs = unittest.mock.Mock(key=lambda program: program)
                experiment = {"seeds": [1], "size": "414x126", **({"frames": frames} if frames else {})}
                job, *_ = planner.input_of(name, 1, experiment)
                place = step.rendered_before(folder, planner.jobs[job]["spec"]["arguments"])
                return place and os.path.basename(place)

            self.assertEqual(found("world/street", 60), "a")
            self.assertEqual(found("world/street"), "c")
            self.assertIsNone(found("world/street", 61))
            self.assertIsNone(found("world/hall"))

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


class GivenPriors(unittest.TestCase):
    """Of a KITTI sequence with prior files, with and without perception outputs."""

    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.root = pathlib.Path(temporary.name) / "data"
        touch(self.root / "kitti" / "07" / "image_0" / "000000.png")
        touch(self.root / "priors" / "kitti" / "07" / "000000.kysp")
        self.perception = self.root / "perception" / "kitti" / "07"
        self.folder = self.root.parent / "work"
        self.folder.mkdir()
        (self.folder / "plan.json").write_text(json.dumps(
            {"bin": "", "source": str(SOURCE), "cores": 1, "jobs": [], "costs": []}))

    def with_perception(self):
        for name in ("panoptic_left", "panoptic_right"):
            touch(self.perception / name / "000000.png")

    def planner(self):
        planner = Plans.Planner(data=str(self.root), cores=1)
        planner.jobs, planner.states, planner.cases = {}, {}, plan.load_yaml("cases.yaml")
        planner.given = data_sets.find(str(self.root))
        planner.programs = unittest.mock.Mock(key=lambda name: name)
        return planner

    def make(self, case, config=None):
        """The prior files of a job of a plan, and the commands that make them."""
        planner = self.planner()
        source = planner.input_of("kitti/07", 1, {"seeds": [1]})
        job = planner.jobs[planner.priors_of(source, "kitti/07", case, config, 1)]
        commands = []
        with unittest.mock.patch.object(prior_steps, "call", lambda command: commands.append(command) or (0, "")):
            prior_steps.make_priors(step.Work(self.folder), job)
        return self.folder / "priors" / job["id"], commands

    def test_exact_ones_are_taken_as_they_are(self):
        for _ in range(2):
            output, commands = self.make("exact")
            self.assertEqual(os.path.realpath(output), os.path.realpath(self.root / "priors" / "kitti" / "07"))
            self.assertEqual(commands, [])
            self.with_perception()

    def test_those_of_another_configuration_are_made_from_perception_outputs(self):
        with self.assertRaisesRegex(step.Failure, "no perception outputs"):
            self.make("exact", "priors_paper.yaml")
        self.with_perception()
        output, (command,) = self.make("exact", "priors_paper.yaml")
        self.assertFalse(output.is_symlink())
        after = lambda option: command[command.index(option) + 1]
        self.assertEqual(after("--config"), str(SOURCE / "configs" / "priors_paper.yaml"))
        self.assertEqual(after("--panoptic-left"), str(self.perception / "panoptic_left"))
        self.assertEqual((after("--disparity"), after("--flow-left")), ("sgbm", "dis"))

    def test_those_with_errors_of_perception_are_made_from_its_outputs(self):
        with self.assertRaisesRegex(step.Failure, "no perception outputs"):
            self.make("sgbm+dis")
        self.with_perception()
        _, (command,) = self.make("sgbm+dis")
        self.assertEqual(command[command.index("--panoptic-right") + 1], str(self.perception / "panoptic_right"))

    def test_times_of_perception(self):
        """Networks of both folders; without perception outputs nothing is timed."""
        def times():
            planner = self.planner()
            job = planner.jobs[planner.perception_of(planner.input_of("kitti/07", 1, {"seeds": [1]}), "kitti/07")]
            with unittest.mock.patch.object(survey_steps, "call", unittest.mock.Mock()) as call:
                found = survey_steps.perception_times(step.Work(self.folder), job)
            for (command,), _ in call.call_args_list:
                self.assertEqual(command[1], str(self.root / "kitti" / "07"))
            return found.keys(), call.call_count

        (self.root / "priors" / "kitti" / "07" / "times.json").write_text(
            json.dumps({"network": 1, "segments": 1, "segmented images": 2}))
        self.assertEqual(times(), ({"segmentation_ms"}, 0))
        self.with_perception()
        (self.perception / "times.json").write_text(json.dumps({"stereo": 1, "stereo fields": 2}))
        self.assertEqual(times(), ({"segmentation_ms", "stereo_network_ms", "classical_ms"}, 2))


class PerceptionByNetworks(unittest.TestCase):
    """Of KITTI sequences without prior files and perception outputs."""

    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)
        self.root = self.folder / "data"
        for k in range(5):
            touch(self.root / "sequences" / "06" / "image_0" / f"{k:06}.png")
            touch(self.root / "mh" / "MH01" / "mav0" / "cam0" / "data" / f"{k}.png")
        self.model, self.weights = self.folder / "n" / "model.yaml", self.folder / "n" / "model.onnx"
        touch(self.weights)
        self.model.write_text("file: model.onnx\nlabel_space: cityscapes_19\n")

    def options(self, **given):
        names = [f"{kind}_{what}" for kind in networks.KINDS for what in ("model", "weights")]
        return argparse.Namespace(**{**dict.fromkeys(names), **{k: str(v) for k, v in given.items()}})

    def planner(self, **given):
        planner = plan.Planner.__new__(plan.Planner)
        planner.options = argparse.Namespace(scale="full", cores=2, data=str(self.root))
        planner.networks = networks.given(self.options(**given))
        planner.lengths = data_sets.lengths()
        planner.given, planner.trajectories = data_sets.find(str(self.root)), {}
        planner.jobs, planner.states, planner.left_out = {}, {}, {}
        planner.cases = plan.load_yaml("cases.yaml")
        planner.programs = unittest.mock.Mock(key=lambda name: name, settings=set(),
                                              modes={"stock", "kys"})
        planner.configurations = {"stock": {"mode": "stock"}, "KYS": {"mode": "kys"},
                                  "literal": {"mode": "kys", "priors": "priors_paper.yaml"}}
        return planner

    def rows(self, planner, name="kitti/06", **more):
        experiment = {"name": "x", "inputs": [name], "seeds": [1], "schedules": ["pipelined"],
                      "configurations": ["stock", "KYS", "literal"], **more}
        return planner.runs_of(experiment)

    def of_kind(self, planner, kind):
        return [job for job in planner.jobs.values() if job["kind"] == kind]

    def test_without_a_network_what_needs_priors_is_left_out_with_one_sentence(self):
        planner = self.planner()
        rows = self.rows(planner, cases=["exact", "parked"])
        self.assertEqual({row["configuration"] for row in rows}, {"stock"})
        (what, why), = planner.left_out["x"].items()
        self.assertIn("kitti/06", what)
        self.assertIn("--segment-model", why)
        self.assertEqual({job["kind"] for job in planner.jobs.values()}, {"run"})

    def test_prior_files_or_outputs_that_are_there_come_first(self):
        for place in ("priors/kitti/06/0.kysp", "perception/kitti/06/panoptic_left/0.png"):
            touch(self.root / place)
        touch(self.root / "perception/kitti/06/panoptic_right/0.png")
        planner = self.planner(segment_model=self.model)
        self.assertEqual(len(self.rows(planner)), 3)
        self.assertEqual(planner.left_out, {})
        self.assertEqual(self.of_kind(planner, "networks"), [])

    def test_prior_files_alone_do_not_fit_literal_ones(self):
        touch(self.root / "priors/kitti/06/0.kysp")
        planner = self.planner()
        self.assertEqual([row["configuration"] for row in self.rows(planner)], ["stock", "KYS"])
        self.assertEqual(len(planner.left_out["x"]), 1)
        planner = self.planner(segment_model=self.model)
        self.assertEqual(len(self.rows(planner)), 3)
        given, made = sorted(self.of_kind(planner, "priors"), key=lambda job: len(job["needs"]))
        self.assertEqual(given["needs"], [])
        self.assertEqual(planner.jobs[made["needs"][0]]["kind"], "networks")

    def test_a_network_is_one_job_of_all_prior_files(self):
        planner = self.planner(segment_model=self.model)
        rows = self.rows(planner, cases=["exact", "parked", "sgbm+dis"])
        network, = self.of_kind(planner, "networks")
        self.assertEqual(network["spec"]["frames"], 0)
        self.assertEqual(network["spec"]["arguments"],
                         ["--model", str(self.model), "--weights", str(self.weights)])
        for job in self.of_kind(planner, "priors"):
            if "decision" in job["spec"]["case"]:
                self.assertEqual(planner.jobs[job["needs"][0]]["needs"], [network["id"]])
            else:
                self.assertEqual(job["needs"], [network["id"]])
                self.assertEqual(job["spec"]["perception"], ["networks", f"perception/{network['id']}"])
                self.assertIn(job["spec"]["config"], ("priors_robust.yaml", "priors_paper.yaml"))
        for row in rows:
            arguments = planner.jobs[row["job"]]["spec"]["arguments"]
            self.assertEqual("control.label_space=cityscapes_19" in arguments,
                             row["configuration"] != "stock")

    def test_first_frames_alone_are_segmented_where_no_more_run(self):
        planner = self.planner(segment_model=self.model)
        self.rows(planner, frames=3)
        self.rows(planner, frames=60)
        self.assertEqual([job["spec"]["frames"] for job in self.of_kind(planner, "networks")], [3, 0])

    def test_another_network_is_another_job(self):
        def job(**more):
            planner = self.planner(segment_model=self.model, **more)
            self.rows(planner)
            return self.of_kind(planner, "networks")[0]["id"]

        first = job()
        self.assertEqual(job(), first)
        self.weights.write_text("other")
        second = job()
        self.model.write_text(self.model.read_text() + "# other\n")
        third = job()
        touch(self.model.with_name("cityscapes_19.classes.csv"))
        touch(self.model.with_name("cityscapes_19.table.csv"))
        fourth = job()
        flow = self.model.with_name("flow.yaml")
        flow.write_text("file: model.onnx\n")
        self.assertEqual(len({first, second, third, fourth, job(flow_model=flow)}), 5)
        with unittest.mock.patch.object(networks, "CODE", networks.CODE[:1]):
            self.assertNotEqual(job(), fourth)

    def test_what_is_wrong_with_a_network_is_said(self):
        broken = self.model.with_name("broken.yaml")
        for content, message in (("[", "broken.yaml"), ("3", "list of settings"),
                                 ("file: none.onnx\nlabel_space: a", "none.onnx: no such file"),
                                 ("file: model.onnx", "label_space is missing")):
            broken.write_text(content)
            with self.assertRaisesRegex(plan.InputError, message):
                networks.given(self.options(segment_model=broken))
        for given, message in (({"segment_model": self.folder / "none.yaml"}, "none.yaml"),
                               ({"segment_weights": self.weights}, "needs --segment-model"),
                               ({"stereo_model": self.model}, "needs --segment-model")):
            with self.assertRaisesRegex(plan.InputError, message):
                networks.given(self.options(**given))
        self.assertIsNone(networks.given(self.options()))

    def test_images_that_are_not_rectified_are_left_out(self):
        planner = self.planner(segment_model=self.model)
        rows = self.rows(planner, "euroc/MH01")
        self.assertEqual([row["configuration"] for row in rows], ["stock"])
        self.assertEqual(list(planner.left_out["x"].values()), [networks.OTHER_LAYOUT])

    def commands(self, planner, kind, config=None):
        """Commands of the jobs of a kind, after make_priors.py would have written its folders."""
        (self.folder / "plan.json").write_text(json.dumps(
            {"bin": "bin", "source": str(SOURCE), "cores": 1, "jobs": [], "costs": []}))
        found = []
        for job in self.of_kind(planner, kind):
            if config and job["spec"].get("config") != config:
                continue
            with unittest.mock.patch.object(prior_steps, "call", lambda c: found.append(c) or (0, "")):
                step.KINDS[kind](step.Work(self.folder), job)
        return found

    def test_steps(self):
        planner = self.planner(segment_model=self.model)
        self.rows(planner, frames=3)
        (command,), job = self.commands(planner, "networks"), self.of_kind(planner, "networks")[0]
        output = str(self.folder / "perception" / job["id"])
        after = lambda option: command[command.index(option) + 1]
        self.assertEqual(command[1], str(SOURCE / "tools" / "perception" / "make_priors.py"))
        self.assertEqual((after("--output"), after("--frames"), after("--model")),
                         (output, "3", str(self.model)))
        self.assertIn("--networks-only", command)
        (command,) = self.commands(planner, "priors", "priors_robust.yaml")
        self.assertEqual((after("--panoptic-right"), after("--label-space"), after("--frames")),
                         (output + "/panoptic/right", "cityscapes_19", "3"))
        self.assertEqual((after("--disparity"), after("--flow-left"), after("--flow")),
                         ("sgbm", "dis", "keypoints"))
        (command,) = self.commands(planner, "priors", "priors_paper.yaml")
        self.assertNotIn("keypoints", command)

    def test_outputs_of_all_networks_and_estimates_in_their_place(self):
        for name in ("disparity", "flow"):
            (self.folder / name / "left").mkdir(parents=True)
        arguments = networks.builder_arguments(str(self.folder), "a", networks.CONFIG)
        after = lambda option, words: words[words.index(option) + 1]
        self.assertEqual(after("--disparity-right", arguments), str(self.folder / "disparity" / "right"))
        self.assertEqual(after("--flow-back-left", arguments), str(self.folder / "flow_back" / "left"))
        estimates = prior_steps.with_estimates(arguments, "sgbm", "dis")
        self.assertEqual((after("--disparity", estimates), after("--flow-right", estimates)), ("sgbm", "dis"))
        self.assertFalse([word for word in estimates if "back" in word or "disparity-right" in word])


class Parts(unittest.TestCase):
    """Sequences of which only the first frames are there, or run."""

    def labels(self, here, frames=None, name="kitti/06"):
        with tempfile.TemporaryDirectory() as folder:
            for k in range(here):
                touch(pathlib.Path(folder) / "06" / "image_2" / f"{k:06}.png")
            planner = plan.Planner.__new__(plan.Planner)
            planner.given = {name: data_sets.Sequence(name, os.path.join(folder, "06"))}
            planner.lengths = {"kitti/06": 7}
            return planner.given_labels(name, {"frames": frames} if frames else {})

    def test_a_part_has_another_name_and_origin(self):
        whole = {"origin": "given", "input": "kitti/06"}
        self.assertEqual(self.labels(7), whole)
        self.assertEqual(self.labels(7, 9), whole)
        self.assertEqual(self.labels(5), {"origin": "partial", "input": "kitti/06 (5 of 7 frames)"})
        self.assertEqual(self.labels(7, 3), {"origin": "partial", "input": "kitti/06 (3 of 7 frames)"})
        self.assertEqual(self.labels(5, 3), {"origin": "partial", "input": "kitti/06 (3 of 7 frames)"})
        # Of unknown length: what is there is taken for all of it.
        self.assertEqual(self.labels(5, name="kitti/21")["origin"], "given")
        self.assertEqual(self.labels(5, 3, "kitti/21")["input"], "kitti/21 (3 of 5 frames)")

    def test_lengths_are_those_of_the_benchmark(self):
        self.assertEqual(data_sets.lengths()["kitti/06"], 1101)

    def test_no_table_has_both_or_published_figures_beside_a_part(self):
        experiment = {**plan.load_yaml("table_1_kitti.yaml"), "name": "table_1_kitti"}

        def row(configuration, **labels):
            return {"seed": 1, "case": "exact", "variant": "matches", "schedule": "pipelined", "repeat": 0,
                    "what": "", "status": "done", "tracked": 100.0, "ate": 1.0, "job": "",
                    "configuration": configuration, **labels}

        part, whole = ({"origin": "partial", "input": "kitti/06 (51 of 1101 frames)"},
                       {"origin": "given", "input": "kitti/07"})
        rows = [row(c, **labels) for c in ("stock", "KYS") for labels in (part, whole)]
        tables = experiment_tables.value_tables(experiment, rows)
        self.assertEqual(len(tables), 2)
        for table in tables:
            partial = part["input"] in table.header
            self.assertNotEqual(partial, "kitti/07" in table.header)
            self.assertEqual(bool(table.groups), not partial, "published figures")
            self.assertEqual("parts of given sequences" in table.title, partial)
            self.assertEqual("not to be compared" in table.note, partial)
        for table in experiment_tables.paired_tables(experiment, rows):
            self.assertFalse("kitti/06" in str(table.rows) and "kitti/07" in str(table.rows), table.title)


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


class DriveTables(unittest.TestCase):
    @staticmethod
    def row(mode, seed, ate, perception="exact", failed=""):
        """Half of the error is scale."""
        return drive_tables.Run("07", "city", perception, mode, seed, 100, 1, ate, ate and ate / 2, 1.01, 0.5,
                                0.25, 0.01, 2, 30, 1, 12.5, failed)

    def test_ratios_to_stock_and_mask(self):
        rows = [self.row("stock", "1", 1.0), self.row("stock", "2", 4.0), self.row("mask", "1", 0.5),
                self.row("kys", "1", 0.5), self.row("kys", "2", 8.0), self.row("kys", "3", None, failed="x")]
        table = drive_tables.ratio_table(rows)
        lines = {line[3]: line for line in table.rows}
        self.assertTrue(all(len(line) == len(table.header) for line in table.rows))
        # 1/2 and 2; mask: seed 1. The same with a free scale.
        for first in (7, 10):
            self.assertEqual(lines["kys"][first:first + 2], ["1.00, 2 of 3 pairs", "1.00, 1 of 3 pairs"])
            self.assertEqual(lines["mask"][first:first + 2], ["0.50", ""])
        self.assertEqual((lines["kys"][5], lines["kys"][9]), ("4.250", "2.125"))
        self.assertEqual((lines["kys"][4], lines["kys"][-1], lines["stock"][7]), (3, 1, ""))

    def test_modes_side_by_side(self):
        """`stock` reads no priors: its runs stand beside each kind of them."""
        rows = [self.row("stock", "1", 1.0), self.row("stock", "2", 2.0)]
        for perception, factor in (("exact", 0.5), ("poor", 4.0)):
            rows += [self.row("mask", "1", 2 * factor, perception), self.row("mask", "2", 4 * factor, perception),
                     self.row("verified", "1", factor, perception), self.row("verified", "2", 2 * factor, perception)]
        table = drive_tables.mode_table(rows)
        self.assertEqual(table.header[3:], ["stock", "mask", "verified", "verified over stock", "over mask",
                                            "free scale: over stock", "over mask"])
        self.assertEqual(table.rows, [
            ["KITTI", "city", "exact", "1.500", "1.500", "0.750", "0.50", "0.50", "0.50", "0.50"],
            ["KITTI", "city", "poor", "1.500", "12.00", "6.000", "4.00", "0.50", "4.00", "0.50"]])
        self.assertEqual(drive_tables.mode_table(rows, "ate_sim3").rows[0][3:6], ["0.750", "0.750", "0.375"])

    def test_rows_that_are_there_are_not_joined_again(self):
        mine, other = self.row("kys", "1", 1.0), self.row("kys", "2", 2.0)
        self.assertEqual(drive_tables.join_runs([mine], [self.row("kys", "1", 9.0), other, other]),
                         [mine, other])

    def test_runs_are_read_as_they_were_written(self):
        rows = [self.row("kys", "1", 1.5), drive_tables.Run("07", "city", "exact", "kys", "2", failed="no room")]
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "drives.csv"
            path.write_text(drive_tables.run_table(rows).comma_separated())
            self.assertEqual(drive_tables.read_runs(path), rows)
            good = path.read_text()
            for bad in ("", "a,b\n", good + "07,city\n", good.replace("1.5", "nan"), good.replace("1.5", "x")):
                path.write_text(bad)
                with self.assertRaises(drive_tables.InputError) as caught:
                    drive_tables.read_runs(path)
                self.assertIn("drives.csv", str(caught.exception))
                self.assertNotIn("\n", str(caught.exception))


class Drives(unittest.TestCase):
    def test_a_picture_shows_runs_of_its_own_perception_and_those_of_stock(self):
        """`mask` fails with poor priors; `stock` runs with the first ones alone."""
        def run_drive(drive, *_):
            perception = drive.labels[2]
            modes = [mode for mode, _, _ in drive.jobs]
            return ([DriveTables.row(mode, "1", 1.0, perception) for mode in modes],
                    {mode: f"{perception}/{mode}" for mode in modes if (mode, perception) != ("mask", "poor")})

        drawn = []
        modes = ["mask", "stock", "stock:a=1", "kys"]
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()), \
                contextlib.redirect_stderr(io.StringIO()), \
                unittest.mock.patch.multiple(
                    drives, Drive=lambda truth, *labels: argparse.Namespace(labels=labels[:4]),
                    jobs_of=lambda drive, modes, _: [(mode, [], "") for mode in modes],
                    run_drive=run_drive, draw=lambda drive, folders, _: drawn.append(list(folders.items()))), \
                unittest.mock.patch.object(sys, "argv", [
                    "drives.py", folder, "--output", folder, "--sequences", "07", "--traffic", "city",
                    "--perception", "exact,poor", "--seeds", "1", "--modes", ",".join(modes)]):
            self.assertEqual(drives.main(), 0)
        self.assertEqual(drawn, [[(mode, f"exact/{mode}") for mode in modes],
                                 [("stock", "exact/stock"), ("stock:a=1", "exact/stock:a=1"), ("kys", "poor/kys")]])

    def test_a_drive_round_a_block_is_one_a_vehicle_can_make(self):
        rows = np.array(town_path.drive(1500, 3)).reshape(-1, 3, 4)
        turns, places = rows[:, :, :3], rows[:, :, 3]
        self.assertLess(np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(), 1e-12)
        self.assertLess(np.abs(places[0]).max(), 1e-12)
        steps = np.diff(places, axis=0)
        speed = np.linalg.norm(steps, axis=1) * town_path.RATE
        self.assertLess(speed.max(), town_path.CRUISE + 1e-9)
        self.assertGreater(np.count_nonzero(speed == 0), 30)  # waits
        self.assertLess(np.diff(speed).max() * town_path.RATE, 1.02 * town_path.ACCELERATION)  # chords of corners
        ahead = turns[:-1, :, 2]  # the optical axis
        moving = speed > 1
        cosine = (steps * ahead).sum(axis=1)[moving] * town_path.RATE / speed[moving]
        self.assertGreater(cosine.min(), np.cos(np.deg2rad(5)))
        # It comes back to where it was.
        far = np.linalg.norm(places, axis=1)
        self.assertLess(far[int(far.argmax()):].min(), 2)

    def test_pictures_of_a_straight_road_are_from_above(self):
        road = np.stack([np.zeros(50), np.linspace(0, 0.1, 50), np.linspace(0, 40, 50)], axis=-1)
        self.assertEqual(figures.plane_of(road), (0, 2))
        turn = np.stack([np.linspace(0, 10, 50), np.zeros(50), np.linspace(0, 40, 50)], axis=-1)
        self.assertEqual(figures.plane_of(turn), (0, 2))
        self.assertEqual(figures.plane_of(turn[:, [0, 2, 1]]), (0, 1))


if __name__ == "__main__":
    unittest.main()
