# SPDX-License-Identifier: BSD-3-Clause
"""The jobs of a plan that look into prior files, and measure what perception takes (step.py)."""
import csv
import json
import os
import resource
import subprocess
import sys

import numpy as np

from prior_steps import network_times, perception, with_estimates
from runs import Failure, call, read_json, remove, write_text

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "python",
                                "kys_slam"))
import kysp  # noqa: E402


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
