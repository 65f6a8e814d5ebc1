#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Turns the experiments of configs/experiments into jobs of the workflow.

    plan.py --output DIR [--data ROOT] [--scale full|quick|miniature] [--only NAME ...]
            [--segment-model NETWORK.yaml] [--stereo-model NETWORK.yaml] [--flow-model NETWORK.yaml]

A job is a file DIR/jobs/ID.json: an input to simulate, perception of a recording by networks, prior
files to make, or a run. ID names what
it is and digests all that its result depends on: programs, the code of step.py, arguments, given
data, the jobs it needs. What is done already (DIR/done/ID.json) is therefore never stale.
DIR/plan.json lists the jobs, and by experiment the labels of its runs.
"""
import argparse
import copy
import functools
import hashlib
import json
import os
import re
import subprocess
import sys

import yaml

import data_sets
import networks
from input_plans import InputPlans
from prior_plans import CONFIGS, LOST_IMAGES, NO_PRIORS, SOURCE, PriorPlans
from programs import Programs
from runs import FAILED, InputError, digest, read_json, remove, write_text
from inputs import whole  # runs knows where it is

HERE = os.path.dirname(os.path.abspath(__file__))
# What does the jobs.
STEP = [os.path.join(HERE, name) for name in (
    "step.py", "prior_steps.py", "survey_steps.py", "runs.py", "loop_recall.py", "lose_images.py",
    "networks.py", "town_path.py", "tier_picture.py")]
STEP.append(os.path.join(SOURCE, "python", "kys_slam", "kysp.py"))
SCALES = ("full", "quick", "miniature")
DEFAULT_LABEL_SPACE = "coco_panoptic_133"  # of the programs

# The miniature: enough to go through every step, far too little to say anything.
MINIATURE = {"size": "414x126", "frames": 16, "seeds": [1]}


def version_of(source):
    """The commit of the source, with a mark when it was changed since; "" outside of a clone."""
    said = subprocess.run(["git", "describe", "--always", "--dirty", "--exclude", "*"], cwd=source,
                          capture_output=True, text=True, check=False)
    return said.stdout.strip() if said.returncode == 0 else ""


def load_yaml(name):
    path = os.path.join(CONFIGS, "experiments", name)
    try:
        with open(path, encoding="utf-8") as file:
            return yaml.safe_load(file)
    except (OSError, yaml.YAMLError) as error:
        raise InputError(f"{path}: {error}") from None


def short_digest(value):
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:12]


@functools.cache
def code_of_step():
    return [digest(path) for path in STEP]


def slug(*words):
    return re.sub(r"[^A-Za-z0-9.+]+", "-", "-".join(str(w) for w in words if w != "")).strip("-")


def schedules_of(experiment, seed):
    """Schedules of the runs with a seed, each with its number of repeats. Repeated are, as of a
    recording, the runs of the first seed only."""
    repeats = experiment.get("repeats", {})
    return [(schedule, repeats.get(schedule, 1)) for schedule in experiment["schedules"]
            if repeats.get(schedule, 1) == 1 or seed == experiment["seeds"][0]]


class Planner(InputPlans, PriorPlans):
    lengths = {}     # frames of whole recordings, by name

    def __init__(self, options):
        self.options = options
        self.programs = Programs(options.bin)
        self.configurations = load_yaml("configurations.yaml")
        self.cases = load_yaml("cases.yaml")
        self.substitutes = load_yaml("substitutes.yaml")
        self.given = data_sets.find(options.data) if options.data else {}
        self.trajectories = data_sets.find_trajectories(options.data) if options.data else {}
        self.networks = networks.given(options)
        self.lengths = data_sets.lengths()
        self.states = {}
        self.jobs = {}
        self.left_out = {}

    def add(self, kind, words, spec, needs, threads, cost):
        """Registers a job; returns its id. `spec` is all that its result depends on beside STEP."""
        ident = f"{kind}-{slug(*words)}-{short_digest([kind, spec, needs, code_of_step()])}"
        self.jobs[ident] = {"id": ident, "kind": kind, "spec": spec, "needs": needs,
                            "threads": threads, "cost": cost}
        return ident

    # --- runs ----------------------------------------------------------------------------------

    def known(self, settings):
        """Settings the program has; None when one that asks for something is not there yet."""
        kept = []
        for assignment in settings:
            key, _, value = assignment.partition("=")
            if key in self.programs.settings:
                kept.append(assignment)
            elif value not in ("false", "0"):
                return None
        return kept

    def run_of(self, source, name, configuration, settings, case, schedule, repeat, seed, experiment):
        mode, drive = configuration["mode"], name.startswith("drive/")
        loses = bool(LOST_IMAGES & self.cases[case].keys())
        if drive:
            perception = "exact" if mode in NO_PRIORS else self.cases[case].get("perception", "exact")
            source = self.drive_of(name, seed, experiment, perception)
        job, folder, _ = source
        needs = [job] if job else []
        arguments = ["--mode", mode, "--schedule", schedule]
        spec = {"input": folder}
        if job is None:
            spec["state"] = self.state_of(*self.given[name].places)
            if experiment.get("frames"):
                arguments += ["--frames", str(experiment["frames"])]
        config = configuration.get("config")
        if config:
            spec["config"] = config
            spec["config_digest"] = digest(os.path.join(CONFIGS, config))
        priors = None
        if mode not in NO_PRIORS and not drive:
            perceived = "exact" if loses else case
            priors = self.priors_of(source, name, perceived, configuration.get("priors"), seed,
                                    experiment.get("frames") or 0)
            needs.append(priors)
            label_space = self.jobs[priors]["spec"].get("label_space", DEFAULT_LABEL_SPACE)
            if label_space != DEFAULT_LABEL_SPACE:
                settings = [*settings, f"control.label_space={label_space}"]
        for setting in settings:
            arguments += ["--set", setting]
        if loses:
            lost = self.with_lost_images(source, case, priors, seed)
            needs, priors, spec["input"] = [lost], priors and lost, f"inputs/{lost}"
        euroc = "euroc/" in name or "hall" in name
        if job is not None and not drive:
            euroc = self.jobs[job]["spec"]["arguments"][0] == "hall"
        spec.update(program="run_stereo_euroc" if euroc else "run_stereo_kitti",
                    arguments=arguments, priors=priors, repeat=repeat)
        spec["key"] = self.programs.key(spec["program"])
        alone = experiment.get("alone", False)  # its times are the result
        realtime = schedule == "realtime"  # waits for the camera most of the time
        cost = (0.1 if realtime else 0.03) * (experiment.get("frames") or 250)
        return self.add("run", [name.replace("/", ""), seed, configuration["name"],
                                case if priors or drive or loses else "", schedule],
                        spec, needs, self.options.cores if alone else 1, cost)

    def leave_out(self, experiment, what, why):
        self.left_out.setdefault(experiment, {})[what] = why

    def configurations_of(self, experiment):
        """Configurations of an experiment, those of a sweep included, that the program can run."""
        chosen = []
        for name in experiment["configurations"]:
            entry = self.configurations.get(name)
            if entry is None:
                raise InputError(f"experiment {experiment['name']}: no configuration '{name}'")
            chosen.append({"settings": [], **entry, "name": name})
        for value in experiment.get("sweep", {}).get("values", []):
            entry = copy.deepcopy(self.configurations[experiment["sweep"]["configuration"]])
            settings = [s.replace("$", str(v)) for s, v in
                        zip(experiment["sweep"]["settings"], value["set"])]
            chosen.append({**entry, "settings": entry.get("settings", []) + settings,
                           "name": str(value["name"])})
        usable = []
        for c in chosen:
            if c["mode"] not in self.programs.modes:
                self.leave_out(experiment["name"], c["name"], f"no mode {c['mode']} in this program")
            elif self.known(c["settings"]) is None:
                self.leave_out(experiment["name"], c["name"], "a setting this program does not have")
            else:
                usable.append(c)
        return usable

    def has_trajectory(self, experiment, name):
        """Whether the real trajectory of a drive, if it has one, is given."""
        real = name.partition("@")[2]
        if not name.startswith("drive/") or not real or real in self.trajectories:
            return True
        self.leave_out(experiment["name"], name, f"no trajectory of {real} given (--data)")
        return False

    def survey_of(self, source, name, seed, frames=0):
        """Job that reads the prior files of an input; gates show against files without motion."""
        job, folder, labels = source
        exact, still = (self.priors_of(source, name, case, None, seed, frames)
                        for case in ("exact", "blind"))
        package = os.path.join(os.path.dirname(self.options.bin), "python", "kys_slam")
        spec = {"input": folder, "priors": exact, "still": still,
                "python": [digest(e.path) for e in os.scandir(package)
                           if e.name.startswith("_core.") and e.name.endswith(".so")]
                if os.path.isdir(package) else [],
                "compare": self.programs.key("compare_priors"),
                "build": self.programs.key("build_priors")}
        given, needs = self.perceived(name, frames, True) if job is None else ({}, [job])
        spec.update(given)
        ident = self.add("survey", [name.replace("/", ""), seed], spec, [*needs, exact, still], 1, 10)
        return {**labels, "job": ident, "seed": seed, "variant": "", "configuration": "KYS",
                "case": "exact", "schedule": "", "repeat": 0}

    def perception_of(self, source, name, frames=0):
        """Job that measures what perception takes."""
        job, folder, _ = source
        given, needs = self.perceived(name, frames, True) if job is None else ({}, [job])
        spec = {"input": folder, **given, "frames": 6, "build": self.programs.key("build_priors")}
        return self.add("perception", [name.replace("/", "")], spec, needs, self.options.cores, 10)

    def runs_of(self, experiment):
        """All runs of an experiment as rows of labels."""
        rows = []
        configurations = self.configurations_of(experiment)
        for name in experiment["inputs"]:
            if not self.has_trajectory(experiment, name):
                continue
            for seed in experiment["seeds"]:
                if not schedules_of(experiment, seed):
                    continue
                source = (self.drive_of(name, seed, experiment, "exact")
                          if name.startswith("drive/") else self.input_of(name, seed, experiment))
                if source is None:
                    continue
                if experiment.get("kind") == "costs":
                    experiment.setdefault("perception", {})[source[2]["input"]] = self.perception_of(
                        source, name, experiment.get("frames") or 0)
                if experiment.get("kind") == "survey":
                    if not self.leaves_out(experiment, source, name, "exact", None):
                        rows.append(self.survey_of(source, name, seed, experiment.get("frames") or 0))
                    continue
                for configuration in configurations:
                    rows += self.runs_of_input(experiment, source, name, seed, configuration)
        return rows

    def leaves_out(self, experiment, source, name, case, config):
        """Whether a recording has no prior files and none can be made: said once."""
        if source[0] is not None:
            return False
        perceived = "exact" if LOST_IMAGES & self.cases[case].keys() else case
        why = self.why_no_priors(name, perceived, config)
        if why is not None:
            self.leave_out(experiment["name"], f"{source[2]['input']} with priors", why)
        return why is not None

    def runs_of_input(self, experiment, source, name, seed, configuration):
        rows = []
        for variant, extra in experiment.get("variants", {"": []}).items():
            settings = self.known([*configuration["settings"], *extra])
            if settings is None:
                self.leave_out(experiment["name"], variant, "a setting this program does not have")
                continue
            for case in experiment.get("cases", ["exact"]):
                if configuration["mode"] not in NO_PRIORS and self.leaves_out(
                        experiment, source, name, case, configuration.get("priors")):
                    continue
                for schedule, repeats in schedules_of(experiment, seed):
                    for repeat in range(repeats):
                        job = self.run_of(source, name, configuration, settings, case, schedule,
                                          repeat, seed, experiment)
                        rows.append({**source[2], "job": job, "seed": seed, "variant": variant,
                                     "configuration": configuration["name"], "case": case,
                                     "schedule": schedule, "repeat": repeat})
        return rows

    # --- experiments ---------------------------------------------------------------------------

    def experiment(self, file):
        spec = load_yaml(file)
        spec["name"] = file.removesuffix(".yaml")
        spec.setdefault("seeds", [1])
        spec.setdefault("schedules", ["pipelined"])
        if self.options.scale != "full":
            spec.update(spec.get("quick", {}))
        if self.options.inputs:
            spec["inputs"] = [i for i in spec["inputs"] if i in self.options.inputs]
        if self.options.scale == "miniature":
            spec.update(MINIATURE)
            first = spec.get("baseline", spec["configurations"][0])
            others = [c for c in spec["configurations"] if c != first]
            second = [c for c in others if c == "KYS"] or others
            spec["configurations"] = [first, *second[:1]]
            spec["inputs"] = spec["inputs"][:2]
            spec["cases"] = spec.get("cases", ["exact"])[:2]
            if "sweep" in spec:
                spec["sweep"]["values"] = spec["sweep"]["values"][:2]
            if "variants" in spec:
                spec["variants"] = dict(list(spec["variants"].items())[:1])
            spec["repeats"] = {}
        if self.options.seeds:
            spec["seeds"] = self.options.seeds
        if self.options.schedules:
            spec["schedules"] = [s for s in spec["schedules"] if s in self.options.schedules]
        return spec

    def plan(self):
        folder = os.path.join(CONFIGS, "experiments")
        files = sorted(f for f in os.listdir(folder) if re.fullmatch(r"(table|study)_\w+\.yaml", f))
        names = [f.removesuffix(".yaml") for f in files]
        for wanted in self.options.only:
            if wanted not in names:
                raise InputError(f"--only {wanted}: there are {', '.join(names)}")
        experiments, known = [], set()
        for file in files:
            if self.options.only and file.removesuffix(".yaml") not in self.options.only:
                continue
            spec = self.experiment(file)
            known.update(load_yaml(file)["inputs"], spec["inputs"])
            if not spec["schedules"]:
                continue
            spec["runs"] = self.runs_of(spec)
            spec["left_out"] = self.left_out.get(spec["name"], {})
            experiments.append(spec)
        for wanted in self.options.inputs:
            if wanted not in known:
                raise InputError(f"--inputs {wanted}: there are {', '.join(sorted(known))}")
        experiments.sort(key=lambda e: e.get("order", 99))
        return {"scale": self.options.scale, "source": SOURCE, "version": version_of(SOURCE),
                "bin": self.options.bin,
                "data": self.options.data, "worlds": self.options.worlds, "cores": self.options.cores,
                "given": {self.given_labels(n, {})["input"]: s.folder for n, s in self.given.items()},
                "jobs": list(self.jobs),
                "costs": [job["cost"] * min(job["threads"], self.options.cores)
                          for job in self.jobs.values()],  # s of a core, as expected
                "experiments": experiments}


def write_plan(plan, jobs, output):
    """Job files that are there already stay as they are: their times mean something. Failed jobs are
    to be done again."""
    os.makedirs(os.path.join(output, "jobs"), exist_ok=True)
    os.makedirs(os.path.join(output, "done"), exist_ok=True)
    for ident, job in jobs.items():
        path = os.path.join(output, "jobs", ident + ".json")
        if read_json(path) != job:
            write_text(path, json.dumps(job))
    for entry in os.scandir(os.path.join(output, "done")):
        result = read_json(entry.path) if entry.name.endswith(".json") else None
        if isinstance(result, dict) and result.get("status") == FAILED:
            remove(entry.path)
    write_text(os.path.join(output, "plan.json"), json.dumps(plan, indent=1))


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", required=True, metavar="DIR")
    parser.add_argument("--data", default="", metavar="ROOT", help="folder that holds data sets")
    parser.add_argument("--scale", choices=SCALES, default="full")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these experiments")
    parser.add_argument("--inputs", nargs="+", default=[], metavar="NAME", help="these inputs")
    parser.add_argument("--seeds", nargs="+", type=int, default=[], metavar="N",
                        help="instead of those of the experiments")
    parser.add_argument("--schedules", nargs="+", default=[], metavar="NAME",
                        choices=["pipelined", "sequential", "realtime"],
                        help="only runs of these schedules")
    parser.add_argument("--worlds", default="", metavar="DIR",
                        help="worlds rendered before by this simulator: taken where the command in "
                             "their README is the same")
    networks.add_arguments(parser)
    parser.add_argument("--cores", type=whole(1), default=2)
    parser.add_argument("--bin", default=os.path.join(SOURCE, "build", "release", "bin"),
                        metavar="DIR")
    options = parser.parse_args()
    options.data = os.path.abspath(options.data) if options.data else ""
    options.bin = os.path.abspath(options.bin)
    options.worlds = os.path.abspath(options.worlds) if options.worlds else ""
    try:
        for folder in (options.data, options.worlds):
            if folder and not os.path.isdir(folder):
                raise InputError(f"{folder}: no such folder")
        planner = Planner(options)
        plan = planner.plan()
        write_plan(plan, planner.jobs, options.output)
    except (InputError, OSError, subprocess.CalledProcessError) as error:
        print(f"plan.py: {error}", file=sys.stderr)
        return 2
    for name, folder in sorted(plan["given"].items()):
        print(f"found {name} in {folder}")
    for experiment in plan["experiments"]:
        for what, why in experiment["left_out"].items():
            if why in (networks.WITHOUT, networks.OTHER_LAYOUT):
                print(f"{experiment['name']}: left out {what}: {why}")
    left = [cost for j, cost in zip(plan["jobs"], plan["costs"])
            if not os.path.exists(os.path.join(options.output, "done", j + ".json"))]
    runs = sum(len(e["runs"]) for e in plan["experiments"])
    print(f"{len(plan['experiments'])} experiments, {runs} results of {len(plan['jobs'])} jobs, "
          f"{len(left)} of them to do: expected to take {sum(left) / options.cores / 3600:.1f} h "
          f"of {options.cores} cores")
    return 0


if __name__ == "__main__":
    sys.exit(main())
