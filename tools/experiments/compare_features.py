#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""How plausible simulated features are: rendered worlds beside features of the same objects on the same
path.

    compare_features.py WORLD... --output DIR [--frames N] [--bin build/release/bin]

WORLD is a KITTI folder of simulate_sequence, with its ground truth. Its priors are built from its exact
segments, disparity and flow; simulate_features takes its poses.txt and objects.csv, with exact perception.
A rendered camera has no lens distortion: the features have 0.03 px instead of 0.2 px, and world number N
has seed N. Modes stock, kys and mask, schedule pipelined. DIR/compare-features.md: means over the worlds,
and their ratio.
"""
import argparse
import json
import os
import statistics
import sys

from runs import Failure, call, find_program, perception_arguments, remove, shares, tier_counts, write_text
from tables import Table
from inputs import InputError, read_table, run, whole  # runs knows where it is

MODES = ("stock", "kys", "mask")
LENS = "0.03"  # px
COLUMNS = dict.fromkeys(("keypoints", "stereo_matches", "inliers", "prior_coverage"), float)


def track(sequence, mode, options, folder, arguments=()):
    """Means per frame, shares of accepted pairs by tier, and errors (mm) of a run."""
    remove(folder)
    program = find_program(options.bin, "run_stereo_kitti")
    call([program, sequence, "--mode", mode, "--quiet", "--output", folder,
          "--schedule", "pipelined", *options.limit, *arguments])
    rows = read_table(os.path.join(folder, "frames.csv"), COLUMNS)
    found = {name: statistics.fmean(row[name] for row in rows) for name in COLUMNS}
    found |= shares(tier_counts(folder)[1])
    _, printed = call([find_program(options.bin, "evaluate_trajectory"), "--json", "--rpe", "1",
                       "--reference", os.path.join(folder, "ground_truth.tum"),
                       "--estimate", os.path.join(folder, "trajectory.tum")])
    errors = json.loads(printed)
    found["ate"] = 1000 * errors["ate_m"]["rmse"]
    found["step"] = 1000 * errors["rpe_translation_m"]["rmse"]
    return found


def rows_of(runs):
    """(what, value) of the runs of a sequence, by mode."""
    stock, kys, mask = (runs[mode] for mode in MODES)
    yield "keypoints per image", stock["keypoints"]
    yield "on moving objects (dropped by `mask`), %", 100 * (1 - mask["keypoints"] / stock["keypoints"])
    yield "with a class, %", 100 * kys["prior_coverage"]
    for mode in MODES:
        yield f"stereo matches, `{mode}`", runs[mode]["stereo_matches"]
    for mode in MODES:
        yield f"features tracked, `{mode}`", runs[mode]["inliers"]
    for tier, name in (("same_instance", "of one instance"), ("cross_instance", "of two instances"),
                       ("cross_class", "of two classes"), ("bypassed", "with a feature without class")):
        yield f"accepted pairs {name}, `kys`, %", 100 * kys[tier]
    for mode in MODES:
        yield f"translation error per frame, `{mode}`, mm", runs[mode]["step"]
    for mode in MODES:
        yield f"ATE, `{mode}`, mm", runs[mode]["ate"]


def compare(world, number, options):
    """The rows of both, rendered and simulated."""
    name = os.path.join(options.output, f"{number}-{os.path.basename(os.path.normpath(world))}")
    priors, features = name + "-priors", name + ".features"
    call([find_program(options.bin, "build_priors"), world, *perception_arguments(world), "--quiet",
          *options.limit, "--output", priors])
    remove(features)
    call([find_program(options.bin, "simulate_features"), os.path.join(world, "poses.txt"), "--objects",
          os.path.join(world, "objects.csv"), "--width", str(options.width), "--perception", "exact",
          "--lens", LENS, "--seed", str(number), "--quiet", *options.limit, "--output", features])
    rendered, simulated = {}, {}
    for mode in MODES:
        arguments = [] if mode == "stock" else ["--priors", priors]
        rendered[mode] = track(world, mode, options, f"{name}-rendered-{mode}", arguments)
        simulated[mode] = track(features, mode, options, f"{name}-features-{mode}")
    return dict(rows_of(rendered)), dict(rows_of(simulated))


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("world", nargs="+")
    parser.add_argument("--output", required=True)
    parser.add_argument("--frames", type=whole(10), help="number of frames (default: all)")
    parser.add_argument("--width", type=whole(64), default=620, help="px, of the worlds' images (620)")
    parser.add_argument("--bin", default="build/release/bin")
    options = parser.parse_args()
    options.limit = ["--frames", str(options.frames)] if options.frames else []
    os.makedirs(options.output, exist_ok=True)
    pairs = []
    for number, world in enumerate(options.world, 1):
        if not os.path.exists(os.path.join(world, "objects.csv")):
            raise InputError(f"{world}: no world of simulate_sequence with objects.csv")
        print(f"{world} ({number} of {len(options.world)})", file=sys.stderr, flush=True)
        try:
            pairs.append(compare(world, number, options))
        except Failure as error:
            raise InputError(f"{world}: {error}") from error
    rows = []
    for what in pairs[0][0]:
        a, b = (statistics.fmean(pair[side][what] for pair in pairs) for side in (0, 1))
        rows.append([what, f"{a:.3g}" if a < 100 else f"{a:.0f}", f"{b:.3g}" if b < 100 else f"{b:.0f}",
                     f"{b / a:.2f}" if a else "-"])
    table = Table("compare-features", "Rendered worlds and simulated features",
                  ["", "rendered", "features", "ratio"], rows)
    write_text(os.path.join(options.output, table.name + ".md"), table.markdown())
    print(table.markdown())
    return 0


if __name__ == "__main__":
    run(main)
