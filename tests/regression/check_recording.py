#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs a real recording and compares it with its rows in docs/real.json.

    check_recording.py BUILD NAME

A recording whose content is not that of the stored row is not compared. With the versions of the row
every figure has to be the stored one, the digest of the trajectory included; with others (a compiler, a
decoder of JPEG) no more than one frame fewer may be connected, and what differs is reported. Exit
status: 0 passed, 1 failed, 77 skipped.
"""
import argparse
import os
import sys

from harness import SOURCE, Absent, Failure, shared_data, status_of

try:
    import recording_kinds  # the harness knows where they are
    import recording_table
    import recordings
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

TABLE = os.path.join(SOURCE, "docs", "real.json")
UPDATE = "if this was meant to: tools/recordings.sh --table docs/real.json --page docs/real.md"


def compare(stored, row):
    """A line on a row; Failure when it is not as good as the stored one, Absent when it is of other
    content."""
    if "error" in row and "input" not in row:
        raise Failure(f"{row['name']}: {row['error']}")
    if row["input"] != stored["input"]:
        raise Absent(f"another recording: input {row['input']}, stored {stored['input']}")
    verdict, line = recording_table.compare([stored], [row])[0]
    if verdict == recording_table.SAME:
        return line
    if "error" in row or row["versions"] == stored["versions"]:
        raise Failure(f"{line}\n{UPDATE}")
    if row["frames"] != stored["frames"] or row["connected"] < stored["connected"] - 1:
        raise Failure(line)
    return f"{line} (stored with {stored['versions']}, run with {row['versions']})"


def check(name, build):
    stored = [row for row in recording_table.read(TABLE) if row["name"] == name]
    if not stored:
        raise Failure(f"{name}: not in {TABLE}")
    if not os.path.isdir(shared_data()):
        raise Absent(f"{shared_data()} is not here")
    found = [r for r in recording_kinds.find(shared_data()) if r.name == name]
    if not found:
        raise Absent(f"{name} is not in {shared_data()}")
    programs = os.path.join(build, "bin")
    needed = ["evaluate_trajectory"]
    if found[0].kind != "pair":
        needed.append("run_stereo_euroc" if found[0].kind == "EuRoC or TUM-VI" else "run_stereo_kitti")
    elif not any(f.startswith("_core.") for f in _package(build)):
        raise Absent("the Python package was not built")
    for program in needed:
        if not os.path.exists(os.path.join(programs, program)):
            raise Absent(f"{program} was not built")
    output = os.path.join(build, "regression", "recordings", name)
    settings = recordings.parse(["--bin", programs, "--output", output])
    facts = recordings.known()
    for row in stored:
        print(compare(row, recordings.run_one(facts, found[0], row["schedule"], settings)))
    return 0


def _package(build):
    folder = os.path.join(build, "python", "kys_slam")
    return os.listdir(folder) if os.path.isdir(folder) else []


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build")
    parser.add_argument("recording")
    arguments = parser.parse_args()
    return status_of(check, arguments.recording, arguments.build)


if __name__ == "__main__":
    sys.exit(main())
