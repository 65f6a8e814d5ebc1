#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Drives with traffic and perception that errs, along real trajectories: a table over sequences,
traffic, perception, modes of matching and seeds.

    drives.py TRUTH --output DIR [--sequences 07,09,V1_02_medium] [--traffic none,city]
              [--perception exact,estimated] [--modes stock,kys,mask] [--seeds 1,2,3] [--frames N]

TRUTH holds kitti/NN.txt and euroc/NAME.tum.txt. A mode may have settings: kys:kys.normalize=false
is the literal one. Feature files are made when a run needs them, and removed after the last one that
does. A run that is there, of the same programs with the same arguments, is not made again: stop it
and start it again as you like. `stock` reads no priors and runs once per traffic. Written after
every drive: DIR/drives.csv, all runs; DIR/pictures/SEQUENCE-TRAFFIC-PERCEPTION-SEED.png, the
trajectories of all modes, with their errors. Written after every sequence:
  DIR/drives.md              mean, and difference to stock on the same seed
  DIR/drives-ratios.md       errors over those of `stock` and of `mask`, geometric mean over the
                             sequences of a data set and the seeds
  DIR/drives-modes.md        modes side by side, ATE after alignment in SE(3)
  DIR/drives-modes-sim3.md   the same with a free scale
A run that fails is a row with its reason; then the exit status is 2. Runs that are elsewhere (--join,
drives.csv of other folders) are in the tables too.
"""
import argparse
import glob
import hashlib
import json
import os
import sys
import time

import figures
from drive_tables import (Run, join_runs, mode_table, ratio_table, read_runs, run_table,
                          sequence_table)
from runs import (DONE, TRACKING_FAILED, Failure, InputError, call, digest, find_program, read_json,
                  remove, write_text)
from inputs import reading, run, whole  # runs knows where it is


class Drive:
    """One feature file: a sequence, traffic, perception and seed."""

    def __init__(self, truth, sequence, traffic, perception, seed, options):
        euroc = not sequence.isdigit()
        self.trajectory = os.path.join(truth, "euroc" if euroc else "kitti",
                                       sequence + (".tum.txt" if euroc else ".txt"))
        if not os.path.exists(self.trajectory):
            raise InputError(f"{self.trajectory}: no such trajectory")
        self.labels = (sequence, traffic, perception, seed)
        self.program = "run_stereo_euroc" if euroc else "run_stereo_kitti"
        arguments = [self.trajectory, "--traffic", traffic, "--seed", str(seed),
                     "--frame-rate", "20", "--quiet"]
        if options.frames:
            arguments += ["--frames", str(options.frames)]
        simulator = find_program(options.bin, "simulate_features")
        key = json.dumps([digest(simulator), perception, arguments, digest(self.trajectory)])
        self.name = "-".join(map(str, self.labels))
        self.file = os.path.join(options.output, "features",
                                 self.name + "-" + hashlib.sha256(key.encode()).hexdigest()[:8])
        self.command = [simulator, *arguments]  # all but the perception and the output
        self.jobs = []  # (mode, command, folder) of its runs

    def share(self):
        """Share of the image that moving objects cover, as the simulator printed it, %."""
        try:
            with open(self.file + ".log", encoding="utf-8") as file:
                words = file.read().split()
            return float(words[words.index("cover") + 1])
        except (OSError, ValueError):
            return 0.0


def make_features(drives, announce):
    """Makes the files that are not there, of drives that differ in perception only: they have the
    same features, which are simulated once."""
    missing = [drive for drive in drives if not os.path.exists(drive.file)]
    announce(", ".join(drive.name for drive in missing) + ": simulating")
    outputs = [word for drive in missing for word in ("--output", drive.file)]
    os.makedirs(os.path.dirname(missing[0].file), exist_ok=True)
    _, printed = call([*missing[0].command, "--perception",
                       ",".join(drive.labels[2] for drive in missing), *outputs])
    for drive in missing:
        write_text(drive.file + ".log", printed)


def errors_of(program, output, alignment):
    """What the evaluation says about a run's trajectory; {} when it fails."""
    try:
        _, printed = call([program, "--reference", os.path.join(output, "ground_truth.tum"),
                           "--estimate", os.path.join(output, "trajectory.tum"), "--json",
                           "--align", alignment])
        return json.loads(printed)
    except (Failure, ValueError):
        return {}


def finished(command, output):
    """Whether the same program has done this with the same arguments."""
    key = [digest(command[0]), command[1:]]
    return read_json(os.path.join(output, "run.json")) == key


def figures_of(drive, command, output, options):
    """The figures of a run, which is made unless it is there."""
    if not finished(command, output):
        remove(output)
        call([*command, "--quiet", "--output", output], (DONE, TRACKING_FAILED))
        write_text(os.path.join(output, "run.json"), json.dumps([digest(command[0]), command[1:]]))
    evaluation = find_program(options.bin, "evaluate_trajectory")
    scaled = errors_of(evaluation, output, "sim3")
    segments = errors_of(evaluation, output, "se3").get("kitti") or {}
    file = os.path.join(output, "summary.json")
    with reading(file):
        s = read_json(file)
        return {"frames": s["frames"], "lost": s["frames"] - s["frames_tracked"],
                "ate": s.get("ate_se3_rmse_m"), "ate_sim3": scaled.get("ate_m", {}).get("rmse"),
                "scale": scaled.get("scale"), "e_t": segments.get("t_rel_percent"),
                "e_r": segments.get("r_rel_deg_per_100m"), "rpe": s.get("rpe_translation_rmse_m"),
                "loops": s["loops_closed"], "keyframes": s["keyframes"], "submaps": s["submaps"],
                "mover_share": drive.share()}


def run_drive(drive, later, options, announce):
    """Rows of the runs of a drive, and by mode the folders of those that did not fail. When it needs
    its features, those of the `later` drives with the same ones are made with them."""
    sequence, traffic, perception, seed = drive.labels
    rows, folders = [], {}
    for mode, command, folder in drive.jobs:
        try:
            if not finished(command, folder):
                if not os.path.exists(drive.file):
                    make_features([drive, *(d for d in later if not all_finished(d))], announce)
                announce(f"{drive.name}: {mode}")
            errors = figures_of(drive, command, folder, options)
            folders[mode] = folder
        except (Failure, InputError) as error:
            announce(f"{drive.name}: {mode}: {error}")
            errors = {"failed": str(error)}
        rows.append(Run(sequence, traffic, perception, mode, seed, **errors))
    if not options.keep:
        remove(drive.file)
    return rows, folders


def all_finished(drive):
    return all(finished(command, folder) for _, command, folder in drive.jobs)


def jobs_of(drive, modes, options):
    """The runs of a drive: mode, command, folder."""
    jobs = []
    for mode in modes:
        name, *settings = mode.split(":")
        command = [find_program(options.bin, drive.program), drive.file, "--mode", name]
        for setting in settings:
            command += ["--set", setting]
        folder = os.path.join(options.output, "runs", drive.name + "-" + mode.replace(":", "+"))
        jobs.append((mode, command, folder))
    return jobs


def drives_of(sequence, traffic, seed, options):
    """Drives with the same features, one for each perception. `stock` is run with the first."""
    drives = [Drive(options.truth, sequence, traffic, perception, seed, options)
              for perception in options.perception]
    for number, drive in enumerate(drives):
        modes = [m for m in options.modes if number == 0 or reads_priors(m)]
        drive.jobs = jobs_of(drive, modes, options)
    return drives


def reads_priors(mode):
    return mode.split(":")[0] != "stock"


def draw(drive, folders, options):
    """The trajectories of a drive, unless the picture is newer than they are."""
    path = os.path.join(options.output, "pictures", drive.name + ".png")
    times = [os.path.getmtime(os.path.join(folder, "run.json")) for folder in folders.values()]
    if os.path.exists(path) and os.path.getmtime(path) > max(times, default=0):
        return
    os.makedirs(os.path.dirname(path), exist_ok=True)
    sequence, traffic, perception, seed = drive.labels
    title = f"{sequence}, traffic: {traffic}, perception: {perception}, seed {seed}"
    figures.trajectories(folders.items(), title, path)


def sequences_of(truth):
    kitti = [os.path.basename(p)[:-4] for p in sorted(glob.glob(os.path.join(truth, "kitti", "*.txt")))]
    euroc = [os.path.basename(p).split(".")[0]
             for p in sorted(glob.glob(os.path.join(truth, "euroc", "*.tum.txt")))]
    if not kitti + euroc:
        raise InputError(f"{truth}: holds no trajectories (kitti/NN.txt, euroc/NAME.tum.txt)")
    return kitti + euroc


def parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    words = lambda text: text.split(",")
    parser.add_argument("truth")
    parser.add_argument("--output", required=True)
    parser.add_argument("--sequences", type=words, help="default: all in TRUTH")
    parser.add_argument("--traffic", type=words, default=["none", "light", "city", "jam"])
    parser.add_argument("--perception", type=words, default=["exact", "estimated", "poor"])
    parser.add_argument("--modes", type=words,
                        default=["stock", "panoptic", "kys", "kys:kys.normalize=false", "mask"])
    parser.add_argument("--seeds", type=words, default=["1", "2", "3"])
    parser.add_argument("--frames", type=whole(1), help="number of frames of each sequence (default: all)")
    parser.add_argument("--join", nargs="+", default=[], metavar="CSV",
                        help="tables of runs (drives.csv) whose rows are added to the tables")
    parser.add_argument("--bin", default="build/release/bin")
    parser.add_argument("--keep", action="store_true", help="do not remove feature files")
    return parser.parse_args(arguments)


def main():
    options = parse(sys.argv[1:])
    os.makedirs(options.output, exist_ok=True)
    begin = time.monotonic()

    def announce(text):
        print(f"[{time.monotonic() - begin:7.0f} s] {text}", file=sys.stderr, flush=True)

    others = [row for path in options.join for row in read_runs(path)]
    rows = []

    def write_runs():
        joined = join_runs(rows, others)
        write_text(os.path.join(options.output, "drives.csv"), run_table(joined).comma_separated())
        return joined

    def write_tables():
        joined = write_runs()
        tables = [sequence_table(joined), ratio_table(joined), mode_table(joined),
                  mode_table(joined, "ate_sim3")]
        for table in tables:
            write_text(os.path.join(options.output, table.name + ".md"), table.markdown())
        return tables

    tables = []
    for sequence in options.sequences or sequences_of(options.truth):
        for traffic in options.traffic:
            for seed in options.seeds:
                stock = {}  # folders of its runs, which are in the pictures of every perception
                drives = drives_of(sequence, traffic, seed, options)
                for number, drive in enumerate(drives):
                    made, runs = run_drive(drive, drives[number + 1:], options, announce)
                    rows += made
                    stock |= {m: folder for m, folder in runs.items() if not reads_priors(m)}
                    write_runs()
                    folders = stock | runs
                    draw(drive, {m: folders[m] for m in options.modes if m in folders}, options)
        tables = write_tables()
    for table in tables:
        print(table.markdown())
    failed = sum(bool(row.failed) for row in rows)
    announce(f"done; {failed} of {len(rows)} runs failed" if failed else "done")
    return 2 if failed else 0


if __name__ == "__main__":
    run(main)
