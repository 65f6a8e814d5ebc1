# SPDX-License-Identifier: BSD-3-Clause
"""Cases of the regression suite: their input, their runs, and what is compared.

A case is a file NAME.json beside this one; README.md says what is in it. Only the standard library
is used.
"""
import json
import math
import os
import statistics
import sys

from drive import drive_text

FOLDER = os.path.dirname(os.path.abspath(__file__))
SOURCE = os.path.dirname(os.path.dirname(FOLDER))
sys.path.insert(0, os.path.join(SOURCE, "tools", "experiments"))
from runs import (DONE, TRACKING_FAILED, Failure, call, digest,  # noqa: E402
                  perception_arguments, remove)

SKIPPED = 77


class Absent(Exception):
    """The input of a case is not on this machine."""


def case_names():
    return sorted(f[:-5] for f in os.listdir(FOLDER) if f.endswith(".json"))


def load(name):
    with open(os.path.join(FOLDER, name + ".json"), encoding="utf-8") as file:
        return json.load(file)


# --- input -------------------------------------------------------------------------------------


class BuildFolder:
    """Where programs are, and where generated input and results go. `worlds`: another such folder
    that renders the worlds; by default this one."""

    def __init__(self, build, worlds=None):
        self.worlds = worlds or self
        self.bin = os.path.join(build, "bin")
        self.data = os.path.join(build, "regression", "data")
        self.runs = os.path.join(build, "regression", "runs")
        os.makedirs(self.data, exist_ok=True)
        os.makedirs(self.runs, exist_ok=True)

    def program(self, name):
        path = os.path.join(self.bin, name)
        if not os.path.exists(path):
            raise Absent(f"{name} was not built")
        return path


def _make(output, program, arguments, sources, announce):
    """Runs `program arguments --output OUTPUT`, unless that is there, made by the same program with
    the same arguments from the same sources."""
    key = json.dumps([digest(program), arguments, [digest(s) for s in sources]])
    note = output + ".key"
    if os.path.exists(output) and os.path.exists(note):
        with open(note, encoding="utf-8") as file:
            if file.read() == key:
                return False
    announce(f"making {os.path.basename(output)}")
    remove(note)
    remove(output)
    call([program, *arguments, "--output", output])
    with open(note, "w", encoding="utf-8") as file:
        file.write(key)
    return True


def shared_data():
    return os.environ.get("KYS_SHARED_DATA_DIR") or os.path.join(SOURCE, "..", "shared", "data")


def _existing(path):
    if not os.path.exists(path):
        raise Absent(f"{path} is not here")
    return path


def _world(spec, seed, place, announce):
    place = place.worlds
    output = os.path.join(place.data, f"{spec['world']}-{spec['size']}-{spec['frames']}-{seed}")
    arguments = [spec["world"], "--seed", str(seed), "--size", spec["size"], "--quiet"]
    if spec["frames"] > 0:
        arguments += ["--frames", str(spec["frames"])]
    if not spec.get("priors"):
        arguments += ["--images-only"]
        output += "-images"
    if "rig_error" in spec:
        arguments += ["--rig-error", spec["rig_error"]]
        output += "-" + spec["rig_error"].replace(":", "")
    _make(output, place.program("simulate_sequence"), arguments, [], announce)
    return output


def _priors(world, place, announce):
    output = os.path.join(place.data, os.path.basename(world) + "-priors")
    arguments = [world, *perception_arguments(world), "--quiet"]
    _make(output, place.program("build_priors"), arguments, [world + ".key"], announce)
    return output


def _drive(place):
    """The trajectory of the case `drive`. Tests run side by side: one that is current stays as it is."""
    path, text = os.path.join(place.data, "drive.txt"), drive_text()
    if os.path.exists(path):
        with open(path, encoding="utf-8") as file:
            if file.read() == text:
                return path
    new = f"{path}.{os.getpid()}"
    with open(new, "w", encoding="utf-8") as file:
        file.write(text)
    os.replace(new, path)
    return path


def _features(spec, seed, place, announce):
    name = spec["features"]
    if name == "drive":
        trajectory = _drive(place)
    else:
        trajectory = _existing(os.path.join(shared_data(), "ground_truth", name))
        name = os.path.basename(name).split(".")[0]
    arguments = [trajectory, "--seed", str(seed), "--quiet", *spec.get("arguments", [])]
    output = os.path.join(place.data, f"{name}-{seed}.features")
    if "rig_error" in spec:
        arguments += ["--rig-error", spec["rig_error"]]
        output = os.path.join(place.data, f"{name}-{seed}-{spec['rig_error'].replace(':', '')}.features")
    _make(output, place.program("simulate_features"), arguments, [trajectory], announce)
    return output


def make_input(case, seed, place, announce=lambda text: None):
    """The arguments that name the input of a run; generates it where it has to be."""
    spec = case["input"]
    if "world" in spec:
        world = _world(spec, seed, place, announce)
        return [world, "--priors", _priors(world, place, announce)] if spec.get("priors") else [world]
    if "features" in spec:
        return [_features(spec, seed, place, announce)]
    if "shared" in spec:
        return [_existing(os.path.join(shared_data(), spec["shared"]))]
    root = os.environ.get(spec["dataset"])
    if not root:
        raise Absent(f"{spec['dataset']} is not set")
    return [_existing(os.path.join(root, spec["path"]))]


def is_generated(case):
    return "world" in case["input"] or "features" in case["input"]


# --- runs --------------------------------------------------------------------------------------


def run(case, name, arguments, settings, place, allowed=(DONE, TRACKING_FAILED)):
    """Runs the case's program on an input; returns the folder of results. `allowed`: exit status."""
    output = os.path.join(place.runs, name)
    remove(output)
    command = [place.program(case["run"]["program"]), *arguments, *case["run"]["arguments"]]
    for setting in settings:
        command += ["--set", setting]
    call([*command, "--quiet", "--output", output], allowed)
    return output


def read_results(folder):
    """ATE (m), share of frames tracked, and the position of every frame."""
    with open(os.path.join(folder, "summary.json"), encoding="utf-8") as file:
        summary = json.load(file)
    if not summary["complete"]:
        raise Failure(f"{folder}: the run is not complete: {summary['end_reason']}")
    positions = []
    with open(os.path.join(folder, "trajectory.kitti"), encoding="utf-8") as file:
        for line in file:
            row = [float(x) for x in line.split()]
            positions.append([row[3], row[7], row[11]])
    return {
        "ate": summary.get("ate_se3_rmse_m"),
        "completeness": summary["frames_tracked"] / summary["frames"],
        "positions": positions,
        "versions": summary["versions"],
    }


# --- comparison --------------------------------------------------------------------------------


def best_rotation(pairs):
    """Rotation matrix that turns the second points of the pairs onto the first ones, both about
    their means, with the least squared error: the quaternion of Horn (1987), by power iteration."""
    S = [[sum(b[i] * a[j] for a, b in pairs) for j in range(3)] for i in range(3)]
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = S
    N = [[xx + yy + zz, yz - zy, zx - xz, xy - yx],
         [yz - zy, xx - yy - zz, xy + yx, zx + xz],
         [zx - xz, xy + yx, yy - xx - zz, yz + zy],
         [xy - yx, zx + xz, yz + zy, zz - xx - yy]]
    shift = sum(abs(v) for row in N for v in row)  # makes the largest eigenvalue the one of largest size
    q = [1.0, 0.0, 0.0, 0.0]
    for _ in range(20000):
        new = [sum(N[i][j] * q[j] for j in range(4)) + shift * q[i] for i in range(4)]
        norm = math.sqrt(sum(v * v for v in new))
        new = [v / norm for v in new]
        change = max(abs(x - y) for x, y in zip(new, q))
        q = new
        if change < 1e-15:
            break
    w, x, y, z = q
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]


def largest_difference(stored, positions, align=True):
    """m, between stored rows [frame, x, y, z] and the positions of a run; `align`: after the rigid
    motion that brings them together, since a milliradian in the first frames turns all the rest."""
    if not stored or stored[-1][0] >= len(positions):
        return math.inf
    pairs = [(row[1:], positions[row[0]]) for row in stored]
    if align:
        means = [[statistics.fmean(p[k][i] for p in pairs) for i in range(3)] for k in range(2)]
        pairs = [tuple([v - m for v, m in zip(p[k], means[k])] for k in range(2)) for p in pairs]
        R = best_rotation(pairs)
        pairs = [(a, [sum(R[i][j] * b[j] for j in range(3)) for i in range(3)]) for a, b in pairs]
    return max(math.dist(a, b) for a, b in pairs)


def is_exact(expected, results):
    """Whether a run gave the stored trajectory, to the digits stored."""
    rows = expected["trajectory"]["positions"]
    return rows[-1][0] < len(results["positions"]) and all(
        [round(v, 4) for v in results["positions"][row[0]]] == row[1:] for row in rows)


def compare(expected, results):
    """Lines of a table, and the names of the metrics outside their bands."""
    lines, outside = [], []
    for metric in ("ate", "completeness"):
        if metric not in expected:
            continue
        value, (low, high) = results[metric], expected[metric]["band"]
        good = value is not None and low <= value <= high
        stored = expected[metric].get("value")
        lines.append(
            f"{metric:<13} {value if value is None else round(value, 5)!s:>9}   stored "
            f"{stored}, band {low} to {high}{'' if good else '   OUTSIDE'}")
        if not good:
            outside.append(metric)
    if "trajectory" in expected:
        difference = largest_difference(expected["trajectory"]["positions"], results["positions"],
                                        expected["trajectory"]["alignment"].startswith("SE(3)"))
        band = expected["trajectory"]["band"]
        good = difference <= band
        lines.append(f"{'trajectory':<13} {difference:9.5f}   m at most from the stored one, "
                     f"band {band}{'' if good else '   OUTSIDE'}")
        if not good:
            outside.append("trajectory")
    return lines, outside


def spread(values):
    return {
        "values": [round(v, 5) for v in values],
        "mean": round(statistics.fmean(values), 5),
        "standard_deviation": round(statistics.stdev(values), 5),
    }


def report(error):
    print(f"{os.path.basename(sys.argv[0])}: {error}", file=sys.stderr)


def status_of(work, *arguments):
    """Calls a function that returns an exit status, and says why there is none: input that is not here
    is skipped, a failure is reported."""
    try:
        return work(*arguments)
    except Absent as reason:
        print(f"skipped: {reason}")
        return SKIPPED
    except Failure as error:
        report(error)
        return 1
