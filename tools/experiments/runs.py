"""Runs of the run_stereo programs for experiments: made once, kept, and read back as figures."""
import csv
import hashlib
import json
import os
import shutil
import subprocess
import sys

TIERS = ("same_instance", "cross_instance", "cross_class", "bypassed", "gated", "filtered", "skipped")
DONE, TRACKING_FAILED = 0, 3  # exit status of the programs that leave results


class InputError(Exception):
    """Bad input; the message is one line that says what is wrong."""


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
    value = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            value.update(block)
    return value.hexdigest()


def write_text(path, text):
    with open(path + ".new", "w", encoding="utf-8") as file:
        file.write(text)
    os.replace(path + ".new", path)


def read_json(path):
    try:
        with open(path, encoding="utf-8") as file:
            return json.load(file)
    except (OSError, ValueError):
        return None


def run_once(command, output, announce):
    """Runs `command --output OUTPUT` unless it was done before by the same program with the same
    arguments. Returns the summary, or None when the program failed (the reason is announced)."""
    key = [digest(command[0]), command[1:]]
    note = os.path.join(output, "run.json")
    if read_json(note) == key:
        return read_json(os.path.join(output, "summary.json"))
    shutil.rmtree(output, ignore_errors=True)
    done = subprocess.run([*command, "--quiet", "--output", output], capture_output=True, text=True,
                          check=False)
    if done.returncode not in (DONE, TRACKING_FAILED):
        lines = done.stderr.strip().splitlines()
        announce(f"failed with status {done.returncode}: {lines[-1] if lines else 'no message'}")
        return None
    write_text(note, json.dumps(key))
    return read_json(os.path.join(output, "summary.json"))


def tier_counts(output):
    """Pairs of descriptors evaluated and accepted, by tier."""
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


def show(value, digits):
    return "-" if value is None else f"{value:.{digits}f}"


def markdown(header, rows):
    lines = ["| " + " | ".join(header) + " |", "| " + " | ".join("---" for _ in header) + " |"]
    return "\n".join(lines + ["| " + " | ".join(str(x) for x in row) + " |" for row in rows]) + "\n"


def comma_separated(header, rows):
    quote = ['"' + x.replace('"', '""') + '"' if "," in x or '"' in x else x
             for row in [header, *rows] for x in map(str, row)]
    width = len(header)
    return "".join(",".join(quote[i:i + width]) + "\n" for i in range(0, len(quote), width))


def fail(error):
    print(f"{os.path.basename(sys.argv[0])}: {error}", file=sys.stderr)
    return 2
