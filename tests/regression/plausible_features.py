#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated features are like those of a rendered world with the same objects on the same path.

    plausible_features.py BUILD

Means over five worlds are within 1.5 (tools/simulator/README.md). One world says less: ratios within 2,
those of rare pairs within 4, and the ATE is left out.
"""
import argparse
import os
import sys

from harness import BuildFolder, load, make_input, status_of

import compare_features


def limit_of(what):
    if what.startswith("ATE"):
        return float("inf")
    rare = ("two instances", "two classes", "without class")
    return 4 if any(name in what for name in rare) else 2


def check(build):
    place = BuildFolder(build)
    case = load("street")
    output = os.path.join(place.data, "plausible")
    os.makedirs(output, exist_ok=True)
    options = argparse.Namespace(bin=os.path.dirname(place.program("simulate_features")),
                                 output=output, width=620, limit=[])
    world = make_input(case, case["seed"], place)[0]
    rendered, features = compare_features.compare(world, 1, options)
    far = 0
    for what, value in rendered.items():
        ratio = features[what] / value
        limit = limit_of(what)
        inside = 1 / limit <= ratio <= limit
        print(f"{what}: {value:.3g}, {features[what]:.3g}, ratio {ratio:.2f}{'' if inside else ': too far'}")
        far += not inside
    return 1 if far else 0


def main():
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    return status_of(check, sys.argv[1])


if __name__ == "__main__":
    sys.exit(main())
