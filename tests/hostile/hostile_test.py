#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Input that nobody should give a program, and machines that give it too little. Every case: the
program ends by itself within its time, with the status and the line the table says, without an abort,
and what was tracked before is saved.

    hostile_test.py BIN_DIR [CASE ...]
"""
import os
import sys
import tempfile

from harness import (BF, CASES, DISPARITY, FRAMES, FX, Folder, Programs, case, complete, expect,
                     make_sequence, passed)
# Each adds its cases to CASES.
import cases.paths
import cases.priors
import cases.settings
import cases.pairs
import cases.outputs
import cases.limits
import cases.signals


@case
def sound_input_is_tracked(f, programs):
    passed(programs.kitti(f))
    summary = complete(f)
    expect(summary["frames_tracked"] == FRAMES, summary)
    expect(abs(summary["path_length_m"] - (FRAMES - 1) * 6 * BF / DISPARITY / FX) < 0.3, summary)


def run_case(name, programs, sequence, folder, failures):
    path = os.path.join(folder, name)
    os.mkdir(path)
    try:
        CASES[name](Folder(path, sequence), programs)
        error = None
    except AssertionError as problem:
        error = str(problem) or "without a message"
    except Exception as problem:  # pylint: disable=broad-except
        error = f"{type(problem).__name__}: {problem}"
    print(f"{'FAILED' if error else 'passed'}  {name}{': ' + error if error else ''}", flush=True)
    if error:
        failures.append(name)


def main():
    programs = Programs(os.path.abspath(sys.argv[1]))
    wanted = sys.argv[2:]
    names = [n for n in CASES if not wanted or any(w in n for w in wanted)]
    if os.environ.get("KYS_SANITIZE"):  # sanitizers need memory and descriptors of their own
        names = [n for n in names if n not in ("limits_memory", "limits_descriptors",
                                               "limits_a_huge_image_in_the_middle",
                                               "limits_memory_in_use")]
        if not programs.has("simulate_sequence"):
            names = [n for n in names if "simulator" not in n]
    failures = []
    with tempfile.TemporaryDirectory(prefix="kys_hostile_") as folder:
        os.chmod(folder, 0o755)
        sequence = os.path.join(folder, "sequence")
        make_sequence(sequence)
        for name in names:
            run_case(name, programs, sequence, folder, failures)
    print(f"{len(names) - len(failures)} of {len(names)} cases passed")
    return 1 if failures or not names else 0


if __name__ == "__main__":
    sys.exit(main())