#!/usr/bin/env python3
"""A short run in which the n-th open, read, write, rename, start of a thread or allocation fails, for
every n (of the many allocations for a sample, all with --all). Whatever fails: the program ends by
itself with status 0 or 2 and one line, what it wrote is complete, and what was tracked is saved.

    fault_test.py BIN_DIR FAULTS_LIBRARY [--all] [--kinds read,write] [--program sequential]
"""
import argparse
import json
import os
import shutil
import sys
import tempfile

import hostile_test as hostile

KINDS = ("open", "read", "write", "rename", "thread", "memory")
FRAMES = 8


class Runs:
    def __init__(self, arguments, folder):
        self.programs = hostile.Programs(os.path.abspath(arguments.bin))
        self.library = os.path.abspath(arguments.faults)
        self.schedule = arguments.schedule
        self.folder = folder
        self.sequence = os.path.join(folder, "sequence")
        self.output = os.path.join(folder, "out")
        self.map = os.path.join(folder, "m.map")
        self.counts = os.path.join(folder, "counts")
        hostile.make_sequence(self.sequence)

    def run(self, fault):
        shutil.rmtree(self.output, ignore_errors=True)
        for path in (self.map, self.counts):
            if os.path.exists(path):
                os.remove(path)
        environment = dict(os.environ, LD_PRELOAD=self.library, KYS_FAULT=fault,
                           KYS_FAULT_COUNT=self.counts)
        return self.programs.run("run_stereo_kitti", self.sequence, "--output", self.output,
                                 "--quiet", "--frames", str(FRAMES), "--save-map", self.map,
                                 "--schedule", self.schedule, env=environment)

    def count(self):
        hostile.passed(self.run("none:0"))
        with open(self.counts, encoding="ascii") as file:
            return {kind: int(number) for kind, number in map(str.split, file)}

    def check(self, fault):
        result = self.run(fault)
        hostile.expect(result.status in (0, 2), f"status {result.status}: {result.err.strip()}")
        hostile.expect("terminate" not in result.err and "defect" not in result.err, result.err)
        hostile.expect(result.status == 0 or result.err.count("\n") >= 1, "says nothing")
        self.check_files(result)

    def check_files(self, result):
        missing = [name for name in hostile.OUTPUTS
                   if not os.path.isfile(os.path.join(self.output, name))]
        if not os.path.isdir(self.output) or len(missing) == len(hostile.OUTPUTS):
            hostile.expect(result.status == 2, "no results, and says nothing")
            return
        hostile.expect(len(missing) <= 1, f"missing: {missing}")  # one call failed, not many
        hostile.expect(not missing or result.status == 2, "a file is missing, and says nothing")
        left = [name for name in os.listdir(self.output) if name.startswith(".")]
        hostile.expect(not left, f"left: {left}")
        if "summary.json" not in missing:
            with open(os.path.join(self.output, "summary.json"), encoding="utf-8") as file:
                summary = json.load(file)
            hostile.expect(summary["complete"] or result.status == 2, "incomplete with status 0")
            hostile.expect(not summary["complete"] or summary["frames"] == FRAMES, summary)
            if "trajectory.kitti" not in missing:
                rows = hostile.lines(os.path.join(self.output, "trajectory.kitti"))
                hostile.expect(rows == summary["frames"], f"{rows} rows: {summary}")
        if os.path.exists(self.map):
            hostile.passed(self.programs.run(
                "run_stereo_kitti", self.sequence, "--output", self.output + "2", "--quiet",
                "--overwrite", "--frames", "2", "--load-map", self.map, "--localize-only"))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bin")
    parser.add_argument("faults")
    parser.add_argument("--all", action="store_true", help="every allocation: takes an hour")
    parser.add_argument("--allocations", type=int, default=60, help="of the sample")
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--schedule", default="pipelined")
    arguments = parser.parse_args()
    failures = 0
    with tempfile.TemporaryDirectory(prefix="kys_faults_") as folder:
        runs = Runs(arguments, folder)
        counts = runs.count()
        for kind in arguments.kinds.split(","):
            step = 1
            if kind == "memory" and not arguments.all:
                step = max(1, counts[kind] // arguments.allocations)
            points = range(1, counts[kind] + 1, step)
            failed = 0
            for n in points:
                try:
                    runs.check(f"{kind}:{n}")
                except AssertionError as problem:
                    failed += 1
                    print(f"{kind} {n}: {problem}", flush=True)
            failures += failed
            print(f"{kind}: {len(points)} of {counts[kind]} calls failed in turn, "
                  f"{len(points) - failed} as promised", flush=True)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
