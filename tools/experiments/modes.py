#!/usr/bin/env python3
"""Compares the modes of descriptor matching on simulated worlds of several seeds.

    modes.py WORLD... --output DIR [--modes stock kys ...] [--bin build/release/bin]

WORLD is a folder of simulate_sequence whose name ends in its seed ("street3"); worlds of the same
name and other seeds are summed up together. Prior files are made from the world's exact
perception, into DIR/priors, where they are not there already. Written after every run: DIR/runs.csv
(a row per run), DIR/modes.md and DIR/modes.csv (a row per world and mode: mean and standard deviation
over seeds, and of the difference to stock on the same seed; accepted pairs of descriptors by tier;
gated pairs of all that were looked at). What was done before, by the same program with the same
arguments, is not done again.
"""
import argparse
import collections
import os
import re
import statistics
import subprocess
import sys
import time

from runs import (InputError, TIERS, comma_separated, fail, find_program, markdown, program_for,
                  run_once, shares, show, tier_counts, write_text)

MODES = ["stock", "scaled", "hard_mismatch", "soft_filter", "semantic", "panoptic", "kys", "mask"]
EXACT = ("panoptic-left", "panoptic-right", "disparity", "flow-left", "flow-right")
RUN_HEADER = ["world", "seed", "mode", "tracked", "ate_m", "rpe_m", "rpe_deg", "tracking_ms_median",
              "tracking_ms_p95", "keyframes", "loops_closed", "peak_mb"] + [
                  f"{kind}_{tier}" for kind in ("pairs", "accepted") for tier in TIERS]
HEADER = ["world", "mode", "seeds", "tracked %", "ATE m", "+-", "less stock", "+-", "worst seed",
          "tracking ms", "accepted: same instance %", "cross instance %", "cross class %",
          "bypassed %", "pairs gated %"]

Result = collections.namedtuple("Result", "world seed mode summary pairs accepted")


def split_name(folder):
    name = os.path.basename(os.path.normpath(folder))
    match = re.fullmatch(r"(.*?)-?(\d+)", name)
    if not match:
        raise InputError(f"{folder}: its name does not end in a seed")
    if not os.path.exists(os.path.join(folder, "ground_truth.csv")):
        raise InputError(f"{folder}: not a complete world with its perception")
    return match.group(1), int(match.group(2))


def make_priors(world, output, programs, announce):
    announce(f"priors of {os.path.basename(os.path.normpath(world))}")
    command = [find_program(programs, "build_priors"), world, "--output", output, "--quiet"]
    for name in EXACT:
        command += [f"--{name}", os.path.join(world, name.replace("-", "_"))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise InputError((done.stderr.strip().splitlines() or ["build_priors failed"])[-1])


def run_row(r):
    s = r.summary
    total = s["timing_ms"]["total"]
    return [r.world, r.seed, r.mode, s["frames_tracked"] / s["frames"], s.get("ate_se3_rmse_m"),
            s.get("rpe_translation_rmse_m"), s.get("rpe_rotation_rmse_deg"), total["median"],
            total["p95"], s["keyframes"], s["loops_closed"], s["peak_memory_mb"],
            *r.pairs.values(), *r.accepted.values()]


def mean(values):
    return statistics.fmean(values) if values else None


def deviation(values):
    return statistics.stdev(values) if len(values) > 1 else None


def summed_row(world, mode, results):
    mine = [r for r in results if (r.world, r.mode) == (world, mode)]
    ate = {r.seed: r.summary.get("ate_se3_rmse_m") for r in mine}
    ate = {seed: value for seed, value in ate.items() if value is not None}
    stock = {r.seed: r.summary.get("ate_se3_rmse_m") for r in results
             if (r.world, r.mode) == (world, "stock")}
    less = [value - stock[seed] for seed, value in ate.items() if stock.get(seed) is not None]
    accepted = shares({tier: sum(r.accepted[tier] for r in mine) for tier in TIERS})
    gated = shares({tier: sum(r.pairs[tier] for r in mine) for tier in TIERS})["gated"]
    tracked = mean([r.summary["frames_tracked"] / r.summary["frames"] for r in mine])
    worst = max(ate, key=ate.get) if ate else None
    return [world, mode, len(mine), show(100 * tracked, 1), show(mean(list(ate.values())), 4),
            show(deviation(list(ate.values())), 4), show(mean(less), 4), show(deviation(less), 4),
            "-" if worst is None else f"{ate[worst]:.4f} ({worst})",
            show(mean([r.summary["timing_ms"]["total"]["median"] for r in mine]), 2),
            *[show(100 * accepted[tier], 2) for tier in TIERS[:4]], show(100 * gated, 2)]


def write_tables(output, results):
    runs = [[x if x is not None else "" for x in run_row(r)] for r in results]
    write_text(os.path.join(output, "runs.csv"), comma_separated(RUN_HEADER, runs))
    groups = dict.fromkeys((r.world, r.mode) for r in results)
    rows = sorted((summed_row(*g, results) for g in groups), key=lambda row: row[0])
    write_text(os.path.join(output, "modes.md"), markdown(HEADER, rows))
    write_text(os.path.join(output, "modes.csv"), comma_separated(HEADER, rows))
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="+", metavar="WORLD")
    parser.add_argument("--output", required=True, metavar="DIR")
    parser.add_argument("--modes", nargs="+", default=MODES, choices=MODES, metavar="MODE")
    parser.add_argument("--schedule", default="sequential")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--bin", default="build/release/bin", metavar="DIR")
    arguments = parser.parse_args()
    start = time.monotonic()

    def announce(text):
        print(f"{time.monotonic() - start:7.1f} s  {text}", flush=True)

    results, rows, failed = [], [], 0
    try:
        worlds = [(*split_name(w), w) for w in arguments.worlds]
        os.makedirs(os.path.join(arguments.output, "priors"), exist_ok=True)
        for world, seed, folder in worlds:
            priors = os.path.join(arguments.output, "priors", f"{world}{seed}")
            make_priors(folder, priors, arguments.bin, announce)
            for mode in arguments.modes:
                announce(f"{world}{seed} {mode}")
                command = [find_program(arguments.bin, program_for(folder)), folder, "--priors",
                           priors, "--mode", mode, "--schedule", arguments.schedule]
                for setting in arguments.set:
                    command += ["--set", setting]
                output = os.path.join(arguments.output, f"{world}{seed}-{mode}")
                summary = run_once(command, output, announce)
                if summary is None:
                    failed += 1
                    continue
                results.append(Result(world, seed, mode, summary, *tier_counts(output)))
                rows = write_tables(arguments.output, results)
    except (InputError, OSError) as error:
        return fail(error)
    print(markdown(HEADER, rows), end="")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
