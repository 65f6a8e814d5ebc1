#!/usr/bin/env python3
"""Runs a list of sequences and settings, one after the other, and makes a table of the results.

    table.py LIST --output DIR [--bin build/release/bin]

LIST has a line per run: a sequence folder or feature file, then words KEY=VALUE:

    /data/kitti/sequences/07  mode=stock schedule=pipelined orb.features=1500
    kitti00.features          program=run_stereo_kitti

`mode`, `schedule`, `priors`, `program`, `start`, `frames` go to the program's options, other keys to
its settings. `#` begins a comment. A run that is in DIR already, of the same program with the same
arguments, is not made again. Written after every run: DIR/table.md, DIR/table.csv.
"""
import argparse
import os
import shlex
import sys
import time

from runs import (InputError, comma_separated, fail, find_program, markdown, program_for, run_once,
                  show, write_text)

OPTIONS = ("mode", "schedule", "priors", "start", "frames")
HEADER = ["sequence", "mode", "schedule", "settings", "frames", "tracked %", "ATE m", "RPE m",
          "RPE deg", "tracking ms, median", "p95", "peak MB", "keyframes", "loops", "wall s"]


def parse(path):
    runs = []
    try:
        with open(path, encoding="utf-8") as file:
            lines = file.readlines()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    for number, line in enumerate(lines, 1):
        words = shlex.split(line, comments=True)
        if not words:
            continue
        bad = [w for w in words[1:] if "=" not in w]
        if bad:
            raise InputError(f"{path}:{number}: '{bad[0]}' is not KEY=VALUE")
        if not os.path.exists(words[0]):
            raise InputError(f"{path}:{number}: {words[0]}: no such sequence")
        runs.append((words[0], dict(w.split("=", 1) for w in words[1:])))
    if not runs:
        raise InputError(f"{path}: no runs")
    return runs


def command_of(sequence, words, programs):
    command = [find_program(programs, words.get("program") or program_for(sequence)), sequence]
    for key, value in words.items():
        if key in OPTIONS:
            command += [f"--{key}", value]
        elif key != "program":
            command += ["--set", f"{key}={value}"]
    return command


def folder_name(sequence, words):
    parts = [os.path.basename(os.path.normpath(sequence))]
    parts += [f"{k}={os.path.basename(os.path.normpath(v))}" for k, v in sorted(words.items())]
    return "_".join(parts)


def row_of(sequence, words, summary):
    settings = [f"{k}={v}" for k, v in words.items() if k not in OPTIONS and k != "program"]
    head = [os.path.basename(os.path.normpath(sequence))]
    if summary is None:
        return head + [words.get("mode", ""), words.get("schedule", ""), " ".join(settings),
                       "failed"] + [""] * (len(HEADER) - 5)
    total = summary["timing_ms"]["total"]
    return head + [
        summary["mode"], summary["schedule"], " ".join(settings), summary["frames"],
        show(100 * summary["frames_tracked"] / summary["frames"], 1),
        show(summary.get("ate_se3_rmse_m"), 4), show(summary.get("rpe_translation_rmse_m"), 4),
        show(summary.get("rpe_rotation_rmse_deg"), 4), show(total["median"], 1),
        show(total["p95"], 1), show(summary["peak_memory_mb"], 0), summary["keyframes"],
        summary["loops_closed"], show(summary["process"]["wall_s"], 1)]


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("list", metavar="LIST")
    parser.add_argument("--output", required=True, metavar="DIR")
    parser.add_argument("--bin", default="build/release/bin", metavar="DIR")
    arguments = parser.parse_args()
    try:
        runs = parse(arguments.list)
        os.makedirs(arguments.output, exist_ok=True)
        commands = [command_of(sequence, words, arguments.bin) for sequence, words in runs]
    except (InputError, OSError) as error:
        return fail(error)
    rows, start = [], time.monotonic()
    for i, ((sequence, words), command) in enumerate(zip(runs, commands), 1):
        name = folder_name(sequence, words)
        print(f"{time.monotonic() - start:7.1f} s  {i} of {len(runs)}: {name}", flush=True)
        summary = run_once(command, os.path.join(arguments.output, name),
                           lambda text: print(f"           {text}", flush=True))
        rows.append(row_of(sequence, words, summary))
        write_text(os.path.join(arguments.output, "table.md"), markdown(HEADER, rows))
        write_text(os.path.join(arguments.output, "table.csv"), comma_separated(HEADER, rows))
    print(markdown(HEADER, rows), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
