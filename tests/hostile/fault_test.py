#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A short run in which the n-th open, read, write, rename, start of a thread or allocation fails, for
every n. Of the many allocations a sample; with --stacks the first and the last one that each distinct
stack of calls asks for, with --all every one. Whatever fails: the program ends by
itself with status 0 or 2 and one line, what it wrote is complete, and what was tracked is saved.
With rectified images (run_stereo_kitti) and with images to rectify (run_stereo_euroc).

    fault_test.py BIN_DIR FAULTS_LIBRARY [--all] [--kinds read,write] [--schedule sequential]
                  [--programs run_stereo_euroc]
"""
import argparse
import json
import os
import shutil
import sys
import tempfile

import harness

KINDS = ("open", "read", "write", "rename", "thread", "memory")
PROGRAMS = ("run_stereo_kitti", "run_stereo_euroc")
FRAMES = 8


class Runs:
    def __init__(self, arguments, program, folder):
        self.program = program
        self.programs = harness.Programs(os.path.abspath(arguments.bin))
        self.library = os.path.abspath(arguments.faults)
        self.schedule = arguments.schedule
        self.folder = folder
        self.sequence = os.path.join(folder, "sequence")
        self.output = os.path.join(folder, "out")
        self.map = os.path.join(folder, "m.map")
        self.counts = os.path.join(folder, "counts")
        self.sound_map = b""
        harness.make_sequence(self.sequence)
        if program == "run_stereo_euroc":
            rectified, self.sequence = self.sequence, os.path.join(folder, "euroc")
            harness.make_euroc(self.sequence, rectified, distortion="[-0.2, 0.05, 0.0, 0.0]")

    def run(self, fault, stacks=None):
        shutil.rmtree(self.output, ignore_errors=True)
        for path in (self.map, self.counts):
            if os.path.exists(path):
                os.remove(path)
        environment = dict(os.environ, LD_PRELOAD=self.library, KYS_FAULT=fault,
                           KYS_FAULT_COUNT=self.counts)
        if stacks:
            environment["KYS_FAULT_STACKS"] = stacks
        return self.programs.run(self.program, self.sequence, "--output", self.output,
                                 "--quiet", "--frames", str(FRAMES), "--save-map", self.map,
                                 "--schedule", self.schedule, env=environment)

    def read_map(self):
        with open(self.map, "rb") as file:
            return file.read()

    def count(self):
        harness.passed(self.run("none:0"))
        self.sound_map = self.read_map()
        with open(self.counts, encoding="ascii") as file:
            return {kind: int(number) for kind, number in map(str.split, file)}

    def stacks(self, rounds=3):
        """[(fault, ...)] of every stack that asks for memory in one of some runs (which threads wait
        for which differs)."""
        counts = {}
        file_name = os.path.join(self.folder, "stacks")
        for _ in range(rounds):
            harness.passed(self.run("none:0", file_name))
            with open(file_name, encoding="ascii") as file:
                for stack, number in map(str.split, file):
                    counts.setdefault(stack, []).append(int(number))
        # The last one: of the run in which there were fewest, so that there is one.
        return [f"stack:{stack}:{n}" for stack, numbers in sorted(counts.items())
                for n in sorted({1, min(numbers)})], len(counts)

    def check(self, fault):
        result = self.run(fault)
        harness.expect(result.status in (0, 2), f"status {result.status}: {result.err.strip()}")
        harness.expect("terminate" not in result.err and "defect" not in result.err, result.err)
        harness.expect(result.status == 0 or result.err.count("\n") >= 1, "says nothing")
        self.check_files(result)

    def check_files(self, result):
        missing = [name for name in harness.OUTPUTS
                   if not os.path.isfile(os.path.join(self.output, name))]
        if not os.path.isdir(self.output) or len(missing) == len(harness.OUTPUTS):
            harness.expect(result.status == 2, "no results, and says nothing")
            return
        harness.expect(len(missing) <= 1, f"missing: {missing}")  # one call failed, not many
        harness.expect(not missing or result.status == 2, "a file is missing, and says nothing")
        left = [name for name in os.listdir(self.output) if name.startswith(".")]
        harness.expect(not left, f"left: {left}")
        if "summary.json" not in missing:
            with open(os.path.join(self.output, "summary.json"), encoding="utf-8") as file:
                summary = json.load(file)
            harness.expect(summary["complete"] or result.status == 2, "incomplete with status 0")
            harness.expect(not summary["complete"] or summary["frames"] == FRAMES, summary)
            if "trajectory.kitti" not in missing:
                rows = harness.lines(os.path.join(self.output, "trajectory.kitti"))
                harness.expect(rows == summary["frames"], f"{rows} rows: {summary}")
        # A map like that of a run in which nothing fails is sound. One without keyframes is a map
        # to begin with.
        if os.path.exists(self.map) and self.read_map() != self.sound_map:
            harness.passed(self.programs.run(
                self.program, self.sequence, "--output", self.output + "2", "--quiet",
                "--overwrite", "--frames", "2", "--load-map", self.map))


def count_failures(runs, arguments):
    print(runs.program, flush=True)
    failures = 0
    counts = runs.count()
    for kind in arguments.kinds.split(","):
        what = f"{counts[kind]} calls"
        if kind == "memory" and arguments.stacks:
            faults, stacks = runs.stacks()
            what += f" from {stacks} stacks"
            faults = faults[arguments.part[0]::arguments.part[1]]
        else:
            step = 1
            if kind == "memory" and not arguments.all:
                step = max(1, counts[kind] // arguments.allocations)
            faults = [f"{kind}:{n}" for n in range(1, counts[kind] + 1, step)]
        failed = 0
        for k, fault in enumerate(faults):
            try:
                runs.check(fault)
            except AssertionError as problem:
                failed += 1
                print(f"{fault}: {problem}", flush=True)
            if arguments.progress and k % 100 == 99:
                print(f"{kind}: {k + 1} of {len(faults)} so far", flush=True)
        failures += failed
        print(f"{kind}: {what}, {len(faults)} failed in turn, {len(faults) - failed} as promised",
              flush=True)
    return failures


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bin")
    parser.add_argument("faults")
    parser.add_argument("--all", action="store_true", help="every allocation: half an hour")
    parser.add_argument("--stacks", action="store_true",
                        help="first and last allocation of every stack: some thousand runs")
    parser.add_argument("--part", type=int, nargs=2, default=(0, 1), metavar=("K", "N"),
                        help="with --stacks every N-th of them, from the K-th")
    parser.add_argument("--progress", action="store_true")
    parser.add_argument("--allocations", type=int, default=60, help="of the sample")
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--programs", default=",".join(PROGRAMS))
    parser.add_argument("--schedule", default="pipelined")
    arguments = parser.parse_args()
    failures = 0
    for program in arguments.programs.split(","):
        with tempfile.TemporaryDirectory(prefix="kys_faults_") as folder:
            failures += count_failures(Runs(arguments, program, folder), arguments)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
