#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Records what the regression suite compares with: values, bands, and the spread they come from.

    record.py [--build BUILD] [--keep-seeds] [CASE ...]

For each case: a run on the stored seed gives the values. Runs on more seeds (other worlds, other
noise) give the spread of ATE and completeness; runs with slightly other settings ("nudges", which
stand for another compiler or machine) the spread of the trajectory. Real
recordings have no seeds: there the nudges give all spreads. Cases of data sets named by environment
variables carry published values and are left alone.

--keep-seeds takes the spread over seeds as it is stored: after small changes of results.

Takes some minutes; what has been generated is used again.
"""
import argparse
import json
import os
import shlex
import subprocess
import sys
import time

from harness import (FOLDER, SOURCE, Absent, BuildFolder, Failure, case_names, largest_difference, load,
                     make_input, read_results, report, run, spread)

SEEDS = [1, 2, 3, 4, 5]
# Changes that should not matter, to input of every kind: more iterations, settings moved by 2 %.
NUDGES = {
    "mapping.bundle_iterations": lambda v: int(v) + 1,
    "mapping.bundle_refine_iterations": lambda v: int(v) + 1,
    "tracking.motion_radius": lambda v: float(v) * 1.02,
    "tracking.local_radius": lambda v: float(v) * 1.02,
    "stereo.row_tolerance": lambda v: float(v) * 1.02,
    "keyframes.reference_ratio": lambda v: float(v) * 1.02,
}
LEAST_ATE_BAND = 0.002  # m, either way
LEAST_TRAJECTORY_BAND = 0.005  # m
ROWS = 30  # of the stored trajectory, about


def settings_of(case, place):
    text = subprocess.run([place.program(case["run"]["program"]), "--list-settings"],
                          capture_output=True, text=True, check=True).stdout
    values, group = {}, ""
    for line in text.splitlines():
        key, _, value = line.split("#")[0].partition(":")
        if not key.strip():
            continue
        if not key.startswith(" "):
            group = key.strip() + "."
        values[key.strip() if "." in key else group + key.strip()] = value.strip()
    return values


def nudged_runs(name, case, source, place):
    defaults = settings_of(case, place)
    results = []
    for key, change in NUDGES.items():
        setting = f"{key}={change(defaults[key]):.6g}"
        results.append((setting, read_results(run(case, f"{name}-nudge", source, [setting], place))))
    return results


def band_of_ate(value, deviation, nudged):
    """Either way: three standard deviations over the seeds or twice the largest change by a nudge,
    whatever is less, and not less than 2 mm."""
    half = max(min(3 * deviation, 2 * max(abs(v - value) for v in nudged)), LEAST_ATE_BAND)
    return [round(max(0.0, value - half), 5), round(value + half, 5)]


def record(name, case, place, command, announce, keep_seeds):
    seeded = "seed" in case
    source = make_input(case, case.get("seed"), place, announce)
    announce(f"{name}: running")
    base = read_results(run(case, f"{name}-record", source, [], place))
    if base["ate"] is None:
        raise Failure(f"{name}: no ATE")
    nudged = nudged_runs(name, case, source, place)
    stored = case.get("expected") if seeded and keep_seeds else None
    if stored:
        runs = [base]
    elif seeded:
        runs = [base]
        for seed in [s for s in SEEDS if s != case["seed"]]:
            other = make_input(case, seed, place, announce)
            runs.append(read_results(run(case, f"{name}-seed", other, [], place)))
    else:
        runs = [base] + [r for _, r in nudged]
    if any(r["ate"] is None for r in runs):
        raise Failure(f"{name}: a run without ATE")
    if stored:
        ate, completeness = (
            spread([base[m], *stored[m]["spread"]["values"][1:]]) for m in ("ate", "completeness"))
    else:
        ate, completeness = (spread([r[m] for r in runs]) for m in ("ate", "completeness"))
    over = "seeds" if seeded else "nudges"
    frames = len(base["positions"])
    step = max(1, frames // ROWS)
    rows = [[i] + [round(v, 4) for v in base["positions"][i]] for i in range(0, frames, step)]
    moved = [largest_difference(rows, r["positions"]) for _, r in nudged]
    case["expected"] = {
        "ate": {
            "metric": "absolute trajectory error of the left camera, rmse, m",
            "alignment": "SE(3), Umeyama",
            "value": round(base["ate"], 5),
            "band": band_of_ate(base["ate"], ate["standard_deviation"],
                                [r["ate"] for _, r in nudged]),
            "band_from": f"value -+ 3 standard deviations over {over} or twice the largest change by "
                         "a nudge, whatever is less, at least 2 mm",
            "spread": ate,
        },
        "completeness": {
            "metric": "share of frames tracked",
            "value": round(base["completeness"], 5),
            "band": [round(min(completeness["values"]) - 1 / frames, 5), 1.0],
            "band_from": f"least over {over}, less one frame",
            "spread": completeness,
        },
        "trajectory": {
            "metric": "largest distance of a position from the stored one, m",
            "alignment": "SE(3), Umeyama",
            "band": round(max(LEAST_TRAJECTORY_BAND, 2 * max(moved)), 4),
            "band_from": "twice the largest over nudges, at least 5 mm",
            "spread": spread(moved),
            "positions": rows,
        },
    }
    case["recorded"] = {
        "command": command,
        "seeds": SEEDS if seeded else [],
        "nudges": [s for s, _ in nudged],
        "nudged_ate": [round(r["ate"], 5) for _, r in nudged],
        "versions": base["versions"],
    }


def write(name, case):
    """JSON with the positions one row per line."""
    rows = case["expected"]["trajectory"].pop("positions")
    text = json.dumps(case, indent=2)
    case["expected"]["trajectory"]["positions"] = rows
    listed = ",\n".join("        " + json.dumps(row) for row in rows)
    anchor = '"trajectory": {'
    at = text.index(anchor) + len(anchor)
    text = text[:at] + '\n      "positions": [\n' + listed + "\n      ]," + text[at:]
    path = os.path.join(FOLDER, name + ".json")
    with open(path + ".new", "w", encoding="utf-8") as file:
        file.write(text + "\n")
    os.replace(path + ".new", path)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default=os.path.join(SOURCE, "build", "release"))
    parser.add_argument("--keep-seeds", action="store_true",
                        help="spread over seeds: as stored, but for the case's own")
    parser.add_argument("case", nargs="*", help="default: all")
    arguments = parser.parse_args()
    unknown = set(arguments.case) - set(case_names())
    if unknown:
        report(f"no case {', '.join(sorted(unknown))}; there are {', '.join(case_names())}")
        return 2
    place = BuildFolder(os.path.abspath(arguments.build))
    start = time.monotonic()

    def announce(text):
        print(f"{time.monotonic() - start:6.1f} s  {text}", flush=True)

    status = 0
    for name in arguments.case or case_names():
        case = load(name)
        if "dataset" in case["input"]:
            continue
        command = "tests/regression/record.py " + shlex.quote(name)
        try:
            record(name, case, place, command, announce, arguments.keep_seeds)
            write(name, case)
            expected = case["expected"]
            announce(f"{name}: ATE {expected['ate']['value']} in {expected['ate']['band']}, tracked "
                     f"{expected['completeness']['value']}, trajectory within "
                     f"{expected['trajectory']['band']} m")
        except Absent as reason:
            announce(f"{name}: left as it is: {reason}")
        except Failure as error:
            report(error)
            status = 1
    return status


if __name__ == "__main__":
    sys.exit(main())
