#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Does one job of a plan (plan.py): simulates an input, makes prior files, or runs the program.

    step.py WORK ID

Writes WORK/done/ID.json, always: a job that fails says so there and exits with status 0, so that
the others go on and the failure becomes a row of the tables. Prints one line with the time left.
"""
import json
import os
import re
import sys
import time

from loop_recall import recall_of
from prior_steps import lose_images, make_priors, run_networks
from runs import (DONE, FAILED, TRACKING_FAILED, Failure, InputError, call, read_json, read_plan, remove,
                  shares, tier_counts, write_text)
from survey_steps import perception_times, survey
from town_path import write_drive


class Work:
    """The work folder and its plan."""

    def __init__(self, folder):
        self.folder = os.path.abspath(folder)
        self.plan = read_plan(self.folder, "cores", "jobs", "costs")

    def path(self, *parts):
        return os.path.join(self.folder, *parts)  # an absolute part stands for itself

    def job(self, ident):
        path = self.path("jobs", ident + ".json")
        job = read_json(path)
        if not isinstance(job, dict):
            raise InputError(f"{path}: no job; plan.py writes them")
        return job

    def done(self, ident):
        return read_json(self.path("done", ident + ".json"))

    def program(self, name):
        return os.path.join(self.plan["bin"], name)

    def config(self, name):
        return os.path.join(self.plan["source"], "configs", name)


# --- input -------------------------------------------------------------------------------------


def rendered_before(worlds, arguments):
    """The folder among `worlds` whose README names this very command; None when there is none."""
    as_options = lambda words: (words[0], dict(zip(words[1::2], words[2::2])))
    world, options = as_options(arguments)
    for entry in sorted(os.scandir(worlds), key=lambda e: e.name):
        try:
            with open(os.path.join(entry.path, "README"), encoding="utf-8") as file:
                command = re.search(r"simulate_sequence (.*)", file.read())
        except OSError:
            continue
        if command is None:
            continue
        words = command[1].split()
        if "--images-only" in words or len(words) % 2 == 0:
            continue
        name, made = as_options(words)
        made.pop("--output", None)
        if (name, made) == (world, options):
            return entry.path
    return None


def simulate(work, job):
    folder = work.path("inputs", job["id"])
    remove(folder)
    remove(folder + ".partial")
    os.makedirs(os.path.dirname(folder), exist_ok=True)
    worlds = work.plan.get("worlds")
    before = rendered_before(worlds, job["spec"]["arguments"]) if worlds else None
    if before is not None:
        os.symlink(before, folder)
        return {"rendered_before": before}
    call([work.program("simulate_sequence"), *job["spec"]["arguments"], "--output", folder, "--quiet"])
    return {}


def simulate_drive(work, job):
    """A feature file along a recorded trajectory, or along a path that is made."""
    spec, folder = job["spec"], work.path("inputs", job["id"])
    remove(folder)
    os.makedirs(folder)
    trajectory = spec.get("trajectory")
    if trajectory is None:
        trajectory = os.path.join(folder, "path.txt")
        write_drive(trajectory, *spec["path"])
    call([work.program("simulate_features"), trajectory, *spec["arguments"], "--quiet", "--output",
          os.path.join(folder, "drive.features")])
    return {}


# --- runs --------------------------------------------------------------------------------------


def figures_of(output):
    """What the tables need of a run's folder."""
    s = read_json(os.path.join(output, "summary.json"))
    if s is None:
        raise Failure("no summary.json")
    pairs, accepted = tier_counts(output)
    figures = {
        "frames": s["frames"], "tracked": s["frames_tracked"], "ate": s.get("ate_se3_rmse_m"),
        "rpe_m": s.get("rpe_translation_rmse_m"), "rpe_deg": s.get("rpe_rotation_rmse_deg"),
        "keyframes": s["keyframes"], "loops": s["loops_closed"], "submaps": s["submaps"],
        "path_m": s["path_length_m"], "missing_priors": s["missing_priors"],
        "peak_mb": s["peak_memory_mb"], "wall_s": s["process"]["wall_s"],
        "timing_ms": s["timing_ms"], "accepted": shares(accepted),
        "gated": shares(pairs)["gated"],
    }
    try:
        figures.update(recall_of(output))
    except InputError:
        pass  # no ground truth
    return figures


def run(work, job):
    spec = job["spec"]
    output = work.path("runs", job["id"])
    remove(output)
    command = [work.program(spec["program"]), work.path(spec["input"]), *spec["arguments"]]
    if "config" in spec:
        command += ["--config", work.config(spec["config"])]
    if spec["priors"]:
        command += ["--priors", work.path("priors", spec["priors"])]
    status, _ = call([*command, "--quiet", "--output", output], (DONE, TRACKING_FAILED))
    figures = figures_of(output)
    if status == TRACKING_FAILED:
        figures.update(status="lost", reason=f"{figures['tracked']} of {figures['frames']} frames "
                                             "tracked")
    return figures


# --- one job -----------------------------------------------------------------------------------

KINDS = {"input": simulate, "drive": simulate_drive, "networks": run_networks, "priors": make_priors,
         "lost": lose_images, "run": run, "survey": survey, "perception": perception_times}


def do(work, job):
    for need in job["needs"]:
        needed = work.done(need) or {"status": FAILED, "reason": "was not made"}
        if needed["status"] == FAILED:
            return {"status": FAILED, "reason": f"{need.split('-')[0]}: {needed['reason']}"}
    try:
        return {"status": "done", **KINDS[job["kind"]](work, job)}
    except (Failure, InputError, OSError, ValueError, KeyError) as error:
        return {"status": FAILED, "reason": str(error) or type(error).__name__}


def time_left(work, sample=40):
    """Jobs done, all jobs, and the seconds the rest takes if it goes on like those done: like a sample
    of them, for a plan has thousands and this is called after each."""
    costs = dict(zip(work.plan["jobs"], work.plan["costs"]))
    done = sorted(costs.keys() & {f[:-5] for f in os.listdir(work.path("done"))})
    rest = sum(costs.values()) - sum(costs[ident] for ident in done)
    spent = expected = 0.0
    for ident in done[::max(1, len(done) // sample)]:
        result, job = work.done(ident), work.job(ident)
        if result is not None:
            spent += result["seconds"] * min(job["threads"], work.plan["cores"])
            expected += costs[ident]
    pace = spent / expected if expected > 0 else 1.0
    return len(done), len(costs), pace * rest / work.plan["cores"]


def main():
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    try:
        work = Work(sys.argv[1])
        job = work.job(sys.argv[2])
    except InputError as error:
        print(f"step.py: {error}", file=sys.stderr)
        return 2
    start = time.monotonic()
    result = {"id": job["id"], **do(work, job), "seconds": time.monotonic() - start}
    write_text(work.path("done", job["id"] + ".json"), json.dumps(result))
    count, total, seconds = time_left(work)
    said = "" if result["status"] == "done" else f": {result['status']}: {result['reason']}"
    print(f"[{count}/{total}, about {seconds / 60:.0f} min left] {job['id']}{said}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
