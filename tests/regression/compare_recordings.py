#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Compares what two builds make of recordings, byte for byte: trajectories, frames, covariances, maps.

    compare_recordings.py BUILD OTHER [--emulator COMMAND] [--frames N] [--output FOLDER] SEQUENCE...

For builds for two architectures: the emulator starts the programs of OTHER. Both reproducible
schedules. A SEQUENCE is a folder in KITTI's layout or, with a folder mav0, in EuRoC's; FOLDER:N takes
N frames of it. summary.json and the measured columns of frames.csv are left out.
Exit status: 0 the same, 1 a difference, 2 a run failed or was not possible.
"""
import argparse
import os
import shlex
import subprocess
import sys

from compare_builds import differences

SCHEDULES = ("sequential", "pipelined")


def arguments_of(sequence, frames):
    """Program and arguments for one sequence."""
    folder, colon, own = sequence.rpartition(":")
    if colon and own.isdigit():
        sequence, frames = folder, int(own)
    if not os.path.isdir(sequence):
        raise ValueError(f"{sequence}: no such folder")
    euroc = os.path.isdir(os.path.join(sequence, "mav0"))
    limit = ["--frames", str(frames)] if frames else []
    return ["run_stereo_euroc" if euroc else "run_stereo_kitti", sequence, *limit]


def run(build, emulator, arguments, schedule, output):
    """Results of one run in the folder `output`."""
    program, *rest = arguments
    call = [*emulator, os.path.join(build, "bin", program), *rest, "--schedule", schedule, "--quiet",
            "--log-level", "error", "--output", output, "--overwrite",
            "--save-map", os.path.join(output, "map.kysmap")]
    done = subprocess.run(call, check=False)
    if done.returncode != 0:
        raise ValueError(f"exit status {done.returncode}: {shlex.join(call)}")


def compare(number, arguments, options):
    """0, or 1 when results differ."""
    status = 0
    for schedule in SCHEDULES:
        places = [os.path.join(options.output, f"{number}-{schedule}-{name}")
                  for name in ("build", "other")]
        for place, build, emulator in zip(places, (options.build, options.other),
                                          ([], shlex.split(options.emulator))):
            os.makedirs(place, exist_ok=True)
            run(build, emulator, arguments, schedule, place)
        found = differences(*places)
        name = " ".join(arguments[1:])
        print(f"{name} {schedule}: {'differs: ' + ', '.join(found) if found else 'the same bytes'}",
              flush=True)
        status |= bool(found)
    return status


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build")
    parser.add_argument("other")
    parser.add_argument("sequences", nargs="+", metavar="SEQUENCE")
    parser.add_argument("--emulator", default="", help="command that starts the programs of OTHER")
    parser.add_argument("--frames", type=int, default=0, help="of every sequence")
    parser.add_argument("--output", default="runs/compared")
    options = parser.parse_args()
    try:
        calls = [arguments_of(s, options.frames) for s in options.sequences]
        return max([compare(number, call, options) for number, call in enumerate(calls)])
    except (OSError, ValueError) as error:
        print(f"compare_recordings.py: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
