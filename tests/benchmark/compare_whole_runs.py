#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Whole runs with our solvers and with Ceres, in turns, as a table.

    compare_whole_runs.py WHOLE_RUN OUTPUT --rounds 3 kitti:SEQUENCE euroc:SEQUENCE ...

WHOLE_RUN is the program of whole_run.cpp. Ratios are medians over the rounds, each of two runs one
after the other, so that a busy machine meets both alike. Keeps the maps, OUTPUT/NAME-own.map, and
prints every run to the error stream.
"""
import argparse
import json
import os
import statistics
import subprocess
import sys

SOLVERS = ("own", "ceres")


def run(program, layout, sequence, solver, output):
    name = os.path.splitext(os.path.basename(sequence.rstrip("/")))[0]
    place = os.path.join(output, f"{name}-{solver}")
    done = subprocess.run(
        [program, layout, solver, sequence, "--output", place, "--save-map", place + ".map"],
        capture_output=True, text=True, check=True)
    account = json.loads(done.stdout.strip().splitlines()[-1])
    with open(os.path.join(place, "summary.json"), encoding="utf-8") as file:
        summary = json.load(file)
    account["wall_s"] = summary["process"]["wall_s"]
    account["ate"] = summary.get("ate_se3_rmse_m", float("nan"))
    account["loops"] = summary["loops_closed"]
    account["keyframes"] = summary["keyframes"]
    print(json.dumps({"run": name, **account}), file=sys.stderr, flush=True)
    return name, account


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("output")
    parser.add_argument("sequences", nargs="+", metavar="LAYOUT:SEQUENCE")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    os.makedirs(arguments.output, exist_ok=True)
    print("| run | solver | keyframes | loops | ATE m | pose graphs | full bundles | process CPU s "
          "| ratio | wall ratio | peak MB | ratio |")
    print("| --- " * 12 + "|")
    for spec in arguments.sequences:
        layout, sequence = spec.split(":", 1)
        rounds = []
        for _ in range(arguments.rounds):
            pair = {}
            for solver in SOLVERS:
                name, pair[solver] = run(arguments.program, layout, sequence, solver,
                                         arguments.output)
            rounds.append(pair)

        def median(solver, key):
            return statistics.median(r[solver][key] for r in rounds)

        def ratio(solver, key):
            return statistics.median(r[solver][key] / r["own"][key] for r in rounds)

        for solver in SOLVERS:
            one = rounds[0][solver]
            print(f"| {name} | {solver} | {one['keyframes']} | {one['loops']} | {one['ate']:.4f} "
                  f"| {one['graphs']}: {median(solver, 'graph_s'):.2f} s "
                  f"| {one['bundle_rounds']} rounds: {median(solver, 'bundle_s'):.2f} s "
                  f"| {median(solver, 'cpu_s'):.1f} | {ratio(solver, 'cpu_s'):.2f} "
                  f"| {ratio(solver, 'wall_s'):.2f} | {median(solver, 'peak_mb'):.0f} "
                  f"| {ratio(solver, 'peak_mb'):.2f} |", flush=True)


if __name__ == "__main__":
    main()
