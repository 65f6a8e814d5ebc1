# SPDX-License-Identifier: BSD-3-Clause
"""Programs run for experiments and tests: found, called, and their results read back as figures."""
import csv
import hashlib
import json
import os
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "common"))
from inputs import InputError  # noqa: E402

TIERS = ("same_instance", "cross_instance", "cross_class", "bypassed", "gated", "filtered", "skipped")
FAILED = "failed"  # status of a job without a result
DONE, TRACKING_FAILED = 0, 3  # exit status of the run_stereo programs that leave results
EXACT = ("panoptic-left", "panoptic-right", "disparity", "flow-left", "flow-right")


class Failure(Exception):
    """A program failed; the message is one line that says how."""


def program_for(sequence):
    """The program that reads a sequence: EuRoC's layout is known by its folder."""
    euroc = os.path.isdir(os.path.join(sequence, "mav0")) or os.path.basename(sequence) == "mav0"
    return "run_stereo_euroc" if euroc else "run_stereo_kitti"


def find_program(folder, name):
    path = os.path.join(folder, name)
    if not os.access(path, os.X_OK):
        raise InputError(f"{path}: no such program; build it, or see --bin")
    return path


def digest(path):
    """SHA-256 of a file, hexadecimal."""
    value = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            value.update(block)
    return value.hexdigest()


def write_text(path, text):
    """Complete or not at all."""
    with open(path + ".new", "w", encoding="utf-8") as file:
        file.write(text)
    os.replace(path + ".new", path)


def read_json(path):
    """The content; None when there is no such file or it is no JSON."""
    try:
        with open(path, encoding="utf-8") as file:
            return json.load(file)
    except (OSError, ValueError):
        return None


def read_plan(work, *keys):
    """plan.json of a work folder, as plan.py writes it."""
    path = os.path.join(work, "plan.json")
    plan = read_json(path)
    if not isinstance(plan, dict) or any(key not in plan for key in keys):
        raise InputError(f"{path}: no plan, or a damaged one; plan.py writes it")
    return plan


def remove(path):
    if os.path.isdir(path) and not os.path.islink(path):
        shutil.rmtree(path)
    elif os.path.lexists(path):
        os.unlink(path)


def call(command, allowed=(DONE,)):
    """Runs a command; its exit status and standard output.  Failure when the status is another."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in allowed:
        lines = done.stderr.strip().splitlines()
        raise Failure(f"{os.path.basename(command[0])}: status {done.returncode}: "
                      f"{lines[-1] if lines else 'no message'}")
    return done.returncode, done.stdout


def perception_arguments(folder):
    """Options of build_priors for perception outputs in the folders simulate_sequence writes."""
    arguments = []
    for name in EXACT:
        arguments += [f"--{name}", os.path.join(folder, name.replace("-", "_"))]
    return arguments


def tier_counts(output):
    """Pairs of descriptors evaluated and accepted, by tier, of a run's output folder."""
    pairs, accepted = dict.fromkeys(TIERS, 0), dict.fromkeys(TIERS, 0)
    with open(os.path.join(output, "frames.csv"), encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            for tier in TIERS:
                pairs[tier] += int(row[f"pairs_{tier}"])
                accepted[tier] += int(row[f"accepted_{tier}"])
    return pairs, accepted


def shares(counts):
    total = sum(counts.values())
    return {tier: count / total if total else 0.0 for tier, count in counts.items()}
