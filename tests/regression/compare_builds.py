#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Compares the results of two builds, byte for byte: features, prior files, trajectories, maps.

    compare_builds.py BUILD OTHER [CASE...]

For builds with two compilers, or with two versions of a library. BUILD renders the worlds; everything
after the images is computed by both. summary.json and the measured columns of frames.csv are left out.
Exit status: 0 the same, 1 a difference, 77 skipped.
"""
import argparse
import csv
import filecmp
import os
import sys

from harness import BuildFolder, load, make_input, run, status_of

CASES = ("block", "drive_pipelined", "street_rig", "street_verified")
MEASURED = ("ms_", "resident_mb")  # columns of frames.csv, by how they begin


def frame_rows(path):
    """frames.csv without what is measured."""
    with open(path, encoding="utf-8", newline="") as file:
        return [{k: v for k, v in row.items() if not k.startswith(MEASURED)}
                for row in csv.DictReader(file)]


def frames_agree(ours, theirs):
    return frame_rows(ours) == frame_rows(theirs)


def names_of(folder):
    """Files of a folder and of those in it, by path in it."""
    return {os.path.relpath(os.path.join(where, name), folder)
            for where, _, names in os.walk(folder) for name in names}


def is_same(ours, theirs):
    return filecmp.cmp(ours, theirs, shallow=False)


def differences(ours, theirs):
    """Files that differ between two files or folders, or that only one of them has."""
    if os.path.isfile(ours):
        return [] if is_same(ours, theirs) else [os.path.basename(ours)]
    names, others = names_of(ours), names_of(theirs)
    found = sorted(names ^ others)
    for name in sorted(names & others - {"summary.json"}):
        compare = frames_agree if name == "frames.csv" else is_same
        if not compare(os.path.join(ours, name), os.path.join(theirs, name)):
            found.append(name)
    return found


def compare_case(name, build, other):
    """Names of the files that differ, of the generated input and of the results."""
    case = load(name)
    inputs = [make_input(case, case["seed"], place) for place in (build, other)]
    runs = [run(case, f"{name}-compared", arguments, [], place)
            for arguments, place in zip(inputs, (build, other))]
    pairs = [*zip(*inputs), runs]
    return [name for ours, theirs in pairs if ours != theirs for name in differences(ours, theirs)]


def compare_all(names, build, other):
    """0, or 1 when a case differs."""
    status = 0
    for name in names:
        found = compare_case(name, build, other)
        print(f"{name:<16} {'differs: ' + ', '.join(found) if found else 'the same bytes'}", flush=True)
        status |= bool(found)
    return status


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build")
    parser.add_argument("other")
    parser.add_argument("cases", nargs="*", default=CASES, metavar="CASE")
    arguments = parser.parse_args()
    build = BuildFolder(arguments.build)
    return status_of(compare_all, arguments.cases, build, BuildFolder(arguments.other, worlds=build))


if __name__ == "__main__":
    sys.exit(main())
