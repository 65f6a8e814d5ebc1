# SPDX-License-Identifier: BSD-3-Clause
"""The jobs of a plan that make prior files (step.py): perception by networks, prior files with errors,
prior files of inputs that lose images."""
import csv
import os
import sys

import numpy as np

from lose_images import lose
from networks import PERCEPTION as ADAPTERS
from networks import builder_arguments
from runs import Failure, call, perception_arguments, read_json, remove

VKITTI_FRAMES = (("panoptic-left", "instanceSegmentation/Camera_0"),
                 ("panoptic-right", "instanceSegmentation/Camera_1"),
                 ("disparity", "depth/Camera_0"), ("disparity-right", "depth/Camera_1"),
                 ("flow-left", "forwardFlow/Camera_0"), ("flow-right", "forwardFlow/Camera_1"))


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


def lose_images(work, job):
    """The input without some of its images, and the prior files of the others."""
    spec, folder = job["spec"], work.path("inputs", job["id"])
    given = spec["priors"] and work.path("priors", spec["priors"])
    priors = work.path("priors", job["id"])
    remove(folder)
    remove(priors)
    frames = lose(work.path(spec["input"]), folder, given, spec["seed"], **spec["case"])
    if given:
        os.symlink(os.path.join(folder, "priors"), priors)
    return {"frames": len(frames)}
