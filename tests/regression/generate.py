#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Makes the input of all cases, once; what is there and current is kept.

    generate.py BUILD
"""
import sys
import time

from harness import Absent, BuildFolder, Failure, case_names, is_generated, load, make_input, report


def main():
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    place = BuildFolder(sys.argv[1])
    start = time.monotonic()

    def announce(text):
        print(f"{time.monotonic() - start:6.1f} s  {text}", flush=True)

    for name in case_names():
        case = load(name)
        if not is_generated(case):
            continue
        try:
            make_input(case, case["seed"], place, announce)
        except Absent as reason:
            announce(f"{name}: skipped: {reason}")
        except Failure as error:
            report(error)
            return 1
    announce("done")
    return 0


if __name__ == "__main__":
    sys.exit(main())
