#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs a case and compares it with what is stored.

    check.py BUILD CASE [--broken]

--broken runs it with a matcher whose disparities are 5 px too large, and passes when the run succeeds
with an ATE above its band: the suite has to notice. Exit status: 0 passed, 1 failed, 77 skipped.

With KYS_REGRESSION_EXACT=1 in the environment the compiler that recorded has to give the stored
trajectory itself: runs are reproducible, so anything else is a change of results.
"""
import argparse
import os
import sys

from harness import (DONE, BuildFolder, Failure, compare, is_exact, load, make_input, read_results, run,
                     status_of)

FAULT = "stereo.added_disparity=5"


def check_broken(case, results):
    """The run has to come to its end with an ATE that is too large."""
    high = case["expected"]["ate"]["band"][1]
    ate = results["ate"]
    if ate is None:
        raise Failure("no ATE: too few frames tracked to compute it")
    print(f"with {FAULT}: ATE {ate:.5f} m, band to {high} m")
    if ate <= high:
        raise Failure("the fault went unnoticed")


def check_exact(case, results):
    """Says whether the stored trajectory was met to its last digit."""
    if "recorded" not in case or is_exact(case["expected"], results):
        return
    if results["versions"] != case["recorded"]["versions"]:
        print("not the stored trajectory; it was recorded with another version or compiler")
        return
    print("not the stored trajectory, with the compiler that recorded it: results have changed")
    if os.environ.get("KYS_REGRESSION_EXACT") == "1":
        raise Failure("the results have changed; if they were meant to: record.py")


def check(name, place, broken):
    case = load(name)
    if "expected" not in case:
        raise Failure(f"{name}: nothing recorded yet; see record.py")
    source = make_input(case, case.get("seed"), place)
    if broken:
        check_broken(case, read_results(run(case, name + "-broken", source, [FAULT], place, allowed=(DONE,))))
        return 0
    results = read_results(run(case, name, source, [], place))
    lines, outside = compare(case["expected"], results)
    print("\n".join(lines))
    check_exact(case, results)
    if outside:
        raise Failure(f"{name}: {', '.join(outside)} outside the band")
    return 0


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build")
    parser.add_argument("case")
    parser.add_argument("--broken", action="store_true")
    arguments = parser.parse_args()
    return status_of(check, arguments.case, BuildFolder(arguments.build), arguments.broken)


if __name__ == "__main__":
    sys.exit(main())
