#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Figures on the real recordings in a folder; tools/recordings.sh says how to call it.

Every recording runs with the default settings in each schedule. A run that fails is a row with its
message, and the others go on. Exit status: 0; 1 when a recording failed, with --check when a row
differs; 2 for bad input.
"""
import argparse
import csv
import json
import os
import subprocess
import sys
import time

import yaml

import recording_kinds
import recording_table
from runs import DONE, TRACKING_FAILED, Failure, InputError, call, find_program, read_json, write_text
from inputs import first_line, reading, run, whole  # runs knows where it is

FOLDER = os.path.dirname(os.path.abspath(__file__))
SOURCE = os.path.dirname(os.path.dirname(FOLDER))
LEAST_PATH_M = 1.0  # of ground truth, for a scale


def known(path=os.path.join(FOLDER, "recordings.yaml")):
    """The content of recordings.yaml."""
    with reading(path), open(path, encoding="utf-8") as file:
        try:
            return yaml.safe_load(file)
        except yaml.YAMLError as error:
            raise InputError(f"{path}: {first_line(error)}") from None


# --- what of a recording it is -------------------------------------------------------------------


def part_of(facts, recording, ran):
    """In words: the frames that ran, of which recording."""
    excerpt = facts["excerpts"].get(recording.name, {})
    of, first = excerpt.get("of", recording.name), excerpt.get("first", 0)
    if "part" in excerpt:
        return f"{of}: {excerpt['part']}" + (f", first {ran}" if ran < recording.frames_here() else "")
    total = facts["lengths"].get(of)
    span = f"frames {first}-{first + ran - 1}"
    if total is not None:
        return "complete" if ran == total else f"partial: {span} of {total} of {of}"
    if excerpt:
        return f"partial: {span} of {of}"
    here = recording.frames_here()
    return f"all {ran} frames here" if ran == here else f"partial: {span} of {here}"


def left_out(facts, recording, what):
    """Ranges [first, last] of frames of this folder whose ground truth is known to be wrong. `what`:
    position, or heading, whose figures leave out the wrong positions too."""
    excerpt = facts["excerpts"].get(recording.name, {})
    of, shift = excerpt.get("of", recording.name), excerpt.get("first", 0)
    ranges = [[f - shift for f in flaw["frames"]] for flaw in facts["flaws"]
              if flaw["of"] == of and flaw["leaves_out"] in ("position", what)]
    return [[max(a, 0), b] for a, b in ranges if b >= 0]


# --- figures of a run ----------------------------------------------------------------------------


def _frames(output):
    path = os.path.join(output, "frames.csv")
    with reading(path), open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _truth_without(output, ranges, times):
    """ground_truth.tum without the frames in the ranges; its path."""
    path = os.path.join(output, "ground_truth.tum")
    spans = [(times[a] - 1e-6, times[min(b, len(times) - 1)] + 1e-6) for a, b in ranges if a < len(times)]
    if not spans:
        return path
    with reading(path), open(path, encoding="utf-8") as file:
        lines = [line for line in file
                 if line.startswith("#") or not any(a <= float(line.split()[0]) <= b for a, b in spans)]
    names = "-".join(f"{a}-{b}" for a, b in ranges)
    write_text(os.path.join(output, f"ground_truth-without-{names}.tum"), "".join(lines))
    return os.path.join(output, f"ground_truth-without-{names}.tum")


def accuracy(facts, recording, output, programs, times):
    """Figures against the ground truth of a run; {} when it has none."""
    if not os.path.isfile(os.path.join(output, "ground_truth.tum")):
        return {}
    program, estimate = find_program(programs, "evaluate_trajectory"), os.path.join(output, "trajectory.tum")

    def evaluate(what, alignment):
        truth = _truth_without(output, left_out(facts, recording, what), times)
        return json.loads(call([program, "--reference", truth, "--estimate", estimate, "--align", alignment,
                                "--json"])[1])

    rigid = evaluate("position", "se3")
    figures = {"ate_se3_m": round(rigid["ate_m"]["rmse"], 4), "poses_compared": rigid["pairs"]}
    ranges = left_out(facts, recording, "position")
    if ranges:
        figures["frames_left_out"] = ranges
    if rigid["reference_length_m"] >= LEAST_PATH_M:
        free = evaluate("position", "sim3")
        figures["ate_sim3_m"] = round(free["ate_m"]["rmse"], 4)
        figures["scale"] = round(free["scale"], 4)
    if "kitti" in rigid:  # the path is long enough
        segments = evaluate("heading", "se3").get("kitti")
        if segments:
            figures["segments"] = segments["segments"]
            figures["t_rel_percent"] = round(segments["t_rel_percent"], 3)
            figures["r_rel_deg_per_100m"] = round(segments["r_rel_deg_per_100m"], 3)
            figures["frames_left_out_of_segments"] = left_out(facts, recording, "heading")
    return figures


def figures_of(facts, recording, output, programs):
    """All figures of a run's folder, as a row of the table has them."""
    path = os.path.join(output, "summary.json")
    summary = read_json(path)
    if not isinstance(summary, dict):
        raise Failure(f"{path}: no summary, or a damaged one")
    frames = _frames(output)
    with reading(path):
        row = {"frames": summary["frames"], "connected": summary["frames_connected"],
               "keyframes": summary["keyframes"], "loops": summary["loops_closed"],
               "ms_per_frame": round(summary["timing_ms"]["total"]["mean"], 1),
               "cpu_ms_per_frame": round(summary["process"]["cpu_ms_per_frame"], 1),
               "memory_mb": round(summary["peak_memory_mb"]), "versions": summary["versions"]}
    row["part"] = part_of(facts, recording, row["frames"])
    with reading(os.path.join(output, "frames.csv")):
        if "integrity" in frames[0]:  # programs before it have no such column
            row["flagged"] = sum(f["integrity"] != "ok" for f in frames)
        times = [float(f["timestamp"]) for f in frames]
    row["trajectory"] = recording_kinds.digest(os.path.join(output, "trajectory.tum"))[
        :recording_kinds.DIGITS]
    return {**row, **accuracy(facts, recording, output, programs, times)}


def run_one(facts, recording, schedule, settings):
    """A row of the table. Its key `error` says why it has no figures."""
    row = {"name": recording.row, "kind": recording.kind, "schedule": schedule}
    output = os.path.join(settings.output, "runs", recording.row.replace("/", "-") + "-" + schedule)
    os.makedirs(os.path.dirname(output), exist_ok=True)
    try:
        row["input"] = settings.digest(recording)
        command, environment = recording_kinds.command(
            recording, settings.bin, schedule, output, facts["rates"].get(recording.name), settings.frames)
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        lines = done.stderr.strip().splitlines() or ["no message"]
        if done.returncode not in (DONE, TRACKING_FAILED):
            raise Failure(f"status {done.returncode}: {lines[-1]}")
        row.update(figures_of(facts, recording, output, settings.bin))
        if done.returncode == TRACKING_FAILED:
            row["warning"] = lines[-1]
    except (Failure, InputError, OSError) as error:
        row["error"] = first_line(error)
        for folder in (os.path.dirname(recording.folder), os.path.dirname(output)):
            row["error"] = row["error"].replace(folder + os.sep, "")  # the same on every machine
    return row


# --- the whole table -----------------------------------------------------------------------------


class Digests:
    """Digests of input, each made once."""

    def __init__(self, limit):
        self.limit, self.made = limit, {}

    def __call__(self, recording):
        if recording.folder not in self.made:
            self.made[recording.folder] = recording.digest(self.limit)
        return self.made[recording.folder]


def run_all(facts, recordings, settings):
    """Rows of all recordings, with progress on standard error; table.json and table.md grow with them."""
    schedules, rows, begin = settings.schedules or facts["schedules"], [], time.monotonic()
    jobs = [(r, s) for r in recordings for s in schedules]
    for i, (recording, schedule) in enumerate(jobs):
        start = time.monotonic()
        print(f"[{i + 1}/{len(jobs)}] {recording.row}, {schedule} ...", end="", file=sys.stderr, flush=True)
        row = run_one(facts, recording, schedule, settings)
        rows.append(row)
        print(f" {time.monotonic() - start:.0f} s" + (f": {row['error']}" if "error" in row else ""),
              file=sys.stderr, flush=True)
        recording_table.write(settings.output, facts, rows)
    print(f"{len(jobs)} runs in {time.monotonic() - begin:.0f} s; {settings.output}/table.md",
          file=sys.stderr)
    return rows


def parse(arguments):
    parser = argparse.ArgumentParser(prog="recordings.sh", description=__doc__.splitlines()[0])
    parser.add_argument("--data", default=os.environ.get("KYS_SHARED_DATA_DIR")
                        or os.path.join(SOURCE, "..", "shared", "data"))
    parser.add_argument("--bin", default=os.path.join(SOURCE, "build", "release", "bin"))
    parser.add_argument("--output", default=os.path.join(SOURCE, "runs", "recordings"))
    parser.add_argument("--frames", type=whole(1))
    parser.add_argument("--only", nargs="+", default=[])
    parser.add_argument("--schedules", nargs="+", choices=("sequential", "pipelined"))
    parser.add_argument("--check")
    parser.add_argument("--page")
    parser.add_argument("--table")
    settings = parser.parse_args(arguments)
    settings.output = os.path.abspath(settings.output)
    settings.digest = Digests(settings.frames)
    return settings


def main():
    settings, facts = parse(None), known()
    # What is written or compared at the end is checked first: a run may take hours.
    stored = recording_table.read(settings.check) if settings.check else None
    if settings.page:
        recording_table.split_page(settings.page)
    find_program(settings.bin, "evaluate_trajectory")
    recordings = recording_kinds.find(settings.data)
    if settings.only:
        recordings = [r for r in recordings if {r.name, r.row} & set(settings.only)]
    if not recordings and stored is None:
        of = " of these names" if settings.only else " of a known layout"
        raise InputError(f"{settings.data}: no recording{of} here")
    rows = run_all(facts, recordings, settings)
    recording_table.write(settings.output, facts, rows, settings.page, settings.table)
    if stored is None:
        print(recording_table.markdown(facts, rows))
        return 1 if any("error" in row for row in rows) else 0
    chosen = [row for row in stored if not settings.only or row["name"] in settings.only]
    chosen = [row for row in chosen if row["schedule"] in (settings.schedules or facts["schedules"])]
    verdicts = recording_table.compare(chosen, rows)
    print("\n".join(line for _, line in verdicts))
    return 1 if any(verdict == recording_table.DIFFERS for verdict, _ in verdicts) else 0


if __name__ == "__main__":
    run(main)
