# SPDX-License-Identifier: BSD-3-Clause
"""Plans of the experiments: inputs that are found, jobs and what they depend on. No experiment is run."""
import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
import unittest.mock

from experiment_code import SOURCE, touch

try:
    import data_sets
    import experiment_tables
    import networks
    import plan
    import prior_steps
    import results
    import step
    import survey_steps
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)


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
                planner = self.Planner(scale="full")
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


if __name__ == "__main__":
    unittest.main()
