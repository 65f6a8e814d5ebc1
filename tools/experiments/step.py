#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Does one job of a plan (plan.py): simulates an input, makes prior files, or runs the program.

    step.py WORK ID

Writes WORK/done/ID.json, always: a job that fails says so there and exits with status 0, so that
the others go on and the failure becomes a row of the tables. Prints one line with the time left.
"""
import csv
import json
import os
import re
import resource
import subprocess
import sys
import time

import numpy as np

from loop_recall import recall_of
from lose_pictures import lose
from networks import PERCEPTION as ADAPTERS
from networks import builder_arguments
from runs import (DONE, FAILED, TRACKING_FAILED, Failure, InputError, call, perception_arguments,
                  read_json, read_plan, remove, shares, tier_counts, write_text)
from town_path import write_drive

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "python",
                                "kys_slam"))
import kysp  # noqa: E402

VKITTI_FRAMES = (("panoptic-left", "instanceSegmentation/Camera_0"),
                 ("panoptic-right", "instanceSegmentation/Camera_1"),
                 ("disparity", "depth/Camera_0"), ("disparity-right", "depth/Camera_1"),
                 ("flow-left", "forwardFlow/Camera_0"), ("flow-right", "forwardFlow/Camera_1"))


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


# --- priors ------------------------------------------------------------------------------------


def run_networks(work, job):
    """Perception outputs of a recording. What an interrupted job made is kept."""
    spec, output = job["spec"], work.path("perception", job["id"])
    frames = ["--frames", str(spec["frames"])] if spec["frames"] else []
    call([sys.executable, os.path.join(ADAPTERS, "make_priors.py"), spec["input"], "--output", output,
          *spec["arguments"], "--builder", work.program("build_priors"), "--jobs", str(job["threads"]),
          "--networks-only", *frames])
    return network_times(read_json(os.path.join(output, "times.json")) or {})


def perception(work, spec, folder):
    """Options of build_priors: where perception outputs are."""
    if "state" not in spec:
        return perception_arguments(folder)
    if spec["perception"] is None:
        what = "given prior files do not fit, and" if spec["prior_files"] else "no prior files and"
        raise Failure(f"{what} no perception outputs (tools/perception makes them)")
    kind, place = spec["perception"]
    if kind == "networks":
        return builder_arguments(work.path(place), spec["label_space"], spec.get("config"))
    if kind == "vkitti":
        arguments = ["--label-space", "vkitti2", "--disparity-encoding", "vkitti",
                     "--flow-encoding", "vkitti"]
        for option, inside in VKITTI_FRAMES:
            arguments += [f"--{option}", os.path.join(place, inside)]
        return arguments
    arguments = perception_arguments(place)
    for i in range(0, len(arguments), 2):  # what is missing is estimated from the images
        if not os.path.isdir(arguments[i + 1]):
            arguments[i + 1] = "sgbm" if arguments[i] == "--disparity" else "dis"
    return arguments


def replace(arguments, option, value):
    arguments[arguments.index(option) + 1] = value


def with_estimates(arguments, disparity, flow):
    """The same options of build_priors with an estimator of disparity and one of flow instead of files;
    None: the files."""
    arguments = list(arguments)
    if disparity:
        replace(arguments, "--disparity", disparity)
        if "--disparity-right" in arguments:  # estimated together with the left one
            at = arguments.index("--disparity-right")
            del arguments[at:at + 2]
    if flow:
        for side in ("left", "right"):
            replace(arguments, f"--flow-{side}", flow)
            if f"--flow-back-{side}" in arguments:  # that of another estimator
                at = arguments.index(f"--flow-back-{side}")
                del arguments[at:at + 2]
    return arguments


def own_label_space(spec):
    """Option of perturb_priors for a label space that is none of the built-in ones: a path."""
    name = spec.get("label_space", "")
    return ["--label-space", name] if os.sep in name else []


def relabel(work, arguments, case, seed, scratch):
    """Nested errors of the segmentation, the same share in both cameras."""
    at = arguments.index("--label-space") if "--label-space" in arguments else len(arguments)
    space = arguments[at:at + 2]
    for side in ("left", "right"):
        out = os.path.join(scratch, f"panoptic_{side}")
        source = arguments[arguments.index(f"--panoptic-{side}") + 1]
        call([work.program("perturb_priors"), "segments", source, "--output", out, "--share",
              str(case["relabel"]), "--seed", str(seed), *space])
        replace(arguments, f"--panoptic-{side}", out)


def disturb_flow(work, arguments, case, seed, scratch):
    """Noise of the flow; the check against a backward flow would take it out again."""
    said = []
    for side in ("left", "right"):
        out = os.path.join(scratch, f"flow_{side}")
        source = arguments[arguments.index(f"--flow-{side}") + 1]
        _, text = call([work.program("perturb_priors"), "flow", source, "--output", out,
                        "--relative", str(case["flow_relative"]), "--correlation",
                        str(case.get("correlation", 0)), "--seed", str(seed)])
        said.append(text.strip())
        replace(arguments, f"--flow-{side}", out)
    arguments += ["--set", "flow_check.enabled=false"]
    return {"flow_error_px": float(said[0].split()[2])}


def exposure(work, clean, perturbed, folder, scratch):
    """Share of keypoints with wrong priors, % per frame (both cameras): mean, p95, maximum."""
    table = os.path.join(scratch, "exposure.csv")
    call([work.program("compare_priors"), clean, perturbed, folder, "--csv", table])
    frames = {}
    with open(table, encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            seen = frames.setdefault(row["frame"], [0, 0])
            seen[0] += int(row["any"])
            seen[1] += int(row["keypoints"])
    values = [100 * wrong / max(1, total) for wrong, total in frames.values()]
    return {"exposure_mean": float(np.mean(values)), "exposure_max": max(values),
            "exposure_p95": float(np.percentile(values, 95))}


def make_priors(work, job):
    spec, case = job["spec"], job["spec"]["case"]
    output, scratch = work.path("priors", job["id"]), work.path("scratch", job["id"])
    folder = work.path(spec["input"])
    remove(output)
    remove(scratch)
    os.makedirs(scratch)
    if spec.get("prior_files") and not case and not spec["config"]:
        os.makedirs(os.path.dirname(output), exist_ok=True)
        os.symlink(spec["prior_files"], output)
        return {}
    results = {}
    if "decision" in case:
        clean = work.path("priors", job["needs"][-1])
        call([work.program("perturb_priors"), "decisions", clean, "--output", output, "--case",
              case["decision"], "--seed", str(spec["seed"]), *own_label_space(spec)])
        return results
    part = ["--frames", str(spec["frames"])] if spec.get("frames") else []
    arguments = perception(work, spec, folder) + part
    arguments = with_estimates(arguments, case.get("disparity"), case.get("flow"))
    if "relabel" in case:
        relabel(work, arguments, case, spec["seed"], scratch)
    if "flow_relative" in case:
        results.update(disturb_flow(work, arguments, case, spec["seed"], scratch))
    if spec["config"]:
        arguments += ["--config", work.config(spec["config"])]
    for assignment in case.get("set", []):
        arguments += ["--set", assignment]
    _, text = call([work.program("build_priors"), folder, "--output", output, "--quiet", *arguments])
    for line in text.splitlines():
        if line.startswith("fusion "):
            results["fusion_ms"] = float(line.split()[1])
    if "relabel" in case or "flow_relative" in case:
        config = ["--config", work.config(spec["config"])] if spec["config"] else []
        clean = os.path.join(scratch, "clean")
        call([work.program("build_priors"), folder, "--output", clean, "--quiet",
              *perception(work, spec, folder), *part, *config])
        results.update(exposure(work, clean, output, folder, scratch))
    remove(scratch)
    return results


# --- a camera that loses pictures --------------------------------------------------------------


def lose_pictures(work, job):
    """The input without some of its pictures, and the prior files of the others."""
    spec, folder = job["spec"], work.path("inputs", job["id"])
    given = spec["priors"] and work.path("priors", spec["priors"])
    priors = work.path("priors", job["id"])
    remove(folder)
    remove(priors)
    frames = lose(work.path(spec["input"]), folder, given, spec["seed"], **spec["case"])
    if given:
        os.symlink(os.path.join(folder, "priors"), priors)
    return {"frames": len(frames)}


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


# --- what the prior files hold -----------------------------------------------------------------


def survival(work, spec, folder, scratch):
    """Share of keypoints not above each gate, % over all frames and per frame."""
    table = os.path.join(scratch, "gates.csv")
    call([work.program("compare_priors"), work.path("priors", spec["priors"]),
          work.path("priors", spec["still"]), folder, "--csv", table])
    frames = {}
    with open(table, encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            seen = frames.setdefault(row["frame"], [0, 0, 0])
            for i, key in enumerate(("keypoints", "stereo_gate", "temporal_gate")):
                seen[i] += int(row[key])
    total = [sum(f[i] for f in frames.values()) for i in range(3)]
    left = lambda f, i: 100 * (1 - f[i] / max(1, f[0]))
    return {"survival_8": left(total, 1), "survival_20": left(total, 2),
            "survival_per_frame": [left(f, 1) for f in frames.values()]}


def motion_values(folder, frames=40, most=20000):
    """m of the flagged thing segments and mu of their pixels, left camera, a sample of the frames."""
    scores = []
    segments = os.path.join(folder, "segments.csv")
    if os.path.exists(segments):  # not where the files came with the data
        with open(segments, encoding="utf-8", newline="") as file:
            scores = [float(r["m"]) for r in csv.DictReader(file)
                      if r["camera"] == "left" and "1" in (r["magnitude_test"], r["radial_test"])]
    names = sorted(f for f in os.listdir(folder) if f.endswith(".kysp"))
    mu = []
    for name in names[::max(1, len(names) // frames)]:
        camera = kysp.read(os.path.join(folder, name)).cameras[0]
        moving = [k + 1 for k, s in enumerate(camera.segments) if s["flags"] & kysp.DYNAMIC]
        if moving and camera.motion is not None:
            mu.append(camera.motion[np.isin(camera.segment_map, moving)])
    values = np.concatenate(mu) if mu else np.zeros(0)
    return {"m": scores, "mu": [round(float(v), 3) for v in values[::max(1, len(values) // most)]],
            "flagged_pixels": len(values)}


def pipeline_picture(work, spec, folder, scratch):
    """The stages of a frame in the middle, as build_priors draws them."""
    priors = work.path("priors", spec["priors"])
    names = sorted(f[:-5] for f in os.listdir(priors) if f.endswith(".kysp"))
    out = os.path.join(scratch, "stages")
    call([work.program("build_priors"), folder, "--output", out, "--start", str(len(names) // 2),
          "--frames", "2", "--debug-images", "--quiet", *perception(work, spec, folder)])
    return os.path.join(out, "debug", sorted(f for f in os.listdir(os.path.join(out, "debug"))
                                             if f.endswith("_left.png"))[0])


def tier_picture(work, spec, folder, output):
    """Keypoints and stereo matches of a frame by tier; nothing without the Python package."""
    package = os.path.join(os.path.dirname(work.plan["bin"]), "python")
    script = os.path.join(os.path.dirname(os.path.abspath(__file__)), "tier_picture.py")
    done = subprocess.run([sys.executable, script, folder, "--priors",
                           work.path("priors", spec["priors"]), "--output", output],
                          env={**os.environ, "PYTHONPATH": package}, capture_output=True, text=True,
                          check=False)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines()
        return {"no_tier_picture": lines[-1] if lines else f"status {done.returncode}"}
    return {}


def network_times(times):
    """ms per frame of both cameras, by network, of what make_priors measured (times.json). A frame has
    two images, disparity of both, and flow of both in two directions."""
    results = {}
    if times.get("segmented images"):
        results["segmentation_ms"] = 2e3 * (times["network"] + times["segments"]) / times["segmented images"]
    for name, per_frame in (("stereo", 2), ("flow", 4)):
        if times.get(f"{name} fields"):
            results[f"{name}_network_ms"] = 1e3 * per_frame * times[name] / times[f"{name} fields"]
    return results


def perception_times(work, job):
    """Processor time, ms per frame of both cameras, for disparity (SGBM) and flow (DIS): what the
    builder takes with them less what it takes with files; and what make_priors measured of networks."""
    spec, scratch = job["spec"], work.path("scratch", job["id"])
    folder = work.path(spec["input"])
    remove(scratch)
    results, seconds, given = {}, [], spec.get("perception")
    for made in filter(None, (given and work.path(given[1]), spec.get("prior_files"))):
        for place in (made, os.path.dirname(os.path.realpath(made))):
            results.update(network_times(read_json(os.path.join(place, "times.json")) or {}))
    if "state" in spec and not given:
        return results
    files = perception(work, spec, folder)
    if given and given[0] == "networks" and "sgbm" in files:
        return results  # no files to compare with
    for k, arguments in enumerate((files, with_estimates(files, "sgbm", "dis"))):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        call([work.program("build_priors"), folder, "--output", os.path.join(scratch, str(k)),
              "--frames", str(spec["frames"]), "--jobs", "1", "--quiet", *arguments])
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    remove(scratch)
    results["classical_ms"] = 1e3 * (seconds[1] - seconds[0]) / spec["frames"]
    return results


def survey(work, job):
    spec = job["spec"]
    output, scratch = work.path("runs", job["id"]), work.path("scratch", job["id"])
    for place in (output, scratch):
        remove(place)
        os.makedirs(place)
    folder = work.path(spec["input"])
    results = survival(work, spec, folder, scratch)
    values = {"survival_per_frame": results.pop("survival_per_frame"),
              **motion_values(work.path("priors", spec["priors"]))}
    write_text(os.path.join(output, "values.json"), json.dumps(values))
    try:
        os.replace(pipeline_picture(work, spec, folder, scratch), os.path.join(output, "stages.png"))
    except (Failure, IndexError):
        pass  # prior files that came with the data: nothing to build from
    results.update(tier_picture(work, spec, folder, os.path.join(output, "tiers.png")))
    remove(scratch)
    return results


# --- one job -----------------------------------------------------------------------------------

KINDS = {"input": simulate, "drive": simulate_drive, "networks": run_networks, "priors": make_priors, "lost": lose_pictures, "run": run,
         "survey": survey, "perception": perception_times}


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
