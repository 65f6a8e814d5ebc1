#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws a run's trajectory, against ground truth when there is one, into a PNG.

    plot_trajectory.py RUN [--ground-truth FILE] [--output FILE] [--plane xz|xy]

RUN is the output folder of a run (trajectory.tum, summary.json, objects.csv: the paths of moving
objects are drawn as well). Ground truth is RUN/ground_truth.tum
or a KITTI, TUM or EuRoC file; it must be of the left camera. The trajectory is associated with it by
time (KITTI: row by row) and aligned (SE(3), Umeyama). Views from above: x-z for cameras that
drive (y points down), x-y for ground truth whose z points up (EuRoC).
"""
import argparse
import csv
import json
import os
import sys
import tempfile

try:
    import matplotlib
    import numpy as np
except ImportError as error:
    print(f"plot_trajectory.py: {error.name} is missing (install python3-matplotlib)", file=sys.stderr)
    sys.exit(2)

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend comes first)

_TOOLS = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
sys.path.insert(0, os.path.join(_TOOLS, "common"))
sys.path.append(os.path.join(_TOOLS, "..", "python", "kys_slam"))
from inputs import InputError, run as run_tool  # noqa: E402
from labels import label_of, readable  # noqa: E402

MAX_TIME_DIFFERENCE = 0.01  # s
plt.rcParams["text.parse_math"] = False  # a dollar in a name begins no formula


def read_positions(path):
    """Time stamps (N, or None for KITTI files) in s and positions (N x 3) in m."""
    try:
        with open(path, encoding="utf-8") as file:
            lines = [line for line in file if line.strip() and not line.startswith("#")]
        rows = np.array([[float(x) for x in line.replace(",", " ").split()] for line in lines])
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except ValueError:
        raise InputError(f"{path}: not a table of numbers") from None
    if rows.ndim != 2 or len(rows) < 2:
        raise InputError(f"{path}: fewer than two poses")
    if not np.isfinite(rows).all():
        raise InputError(f"{path}: numbers that are not finite")
    if rows.shape[1] == 12:
        return None, rows[:, [3, 7, 11]]
    if rows.shape[1] < 8:
        raise InputError(f"{path}: {rows.shape[1]} columns; KITTI has 12, TUM 8")
    times = rows[:, 0] * (1e-9 if rows[0, 0] > 1e15 else 1.0)
    if (np.diff(times) < 0).any():
        raise InputError(f"{path}: time stamps do not increase")
    return times, rows[:, 1:4]


def associate(times, reference_times):
    """Indices of estimate and reference poses that belong together: nearest in time."""
    right = np.clip(np.searchsorted(reference_times, times), 1, len(reference_times) - 1)
    left_is_nearer = times - reference_times[right - 1] <= reference_times[right] - times
    nearest = np.where(left_is_nearer, right - 1, right)
    ours = np.flatnonzero(np.abs(reference_times[nearest] - times) <= MAX_TIME_DIFFERENCE)
    return ours, nearest[ours]


def align(estimate, reference):
    """Rotation and translation (Umeyama) that move the estimate onto the reference."""
    mean_e, mean_r = estimate.mean(axis=0), reference.mean(axis=0)
    u, _, vt = np.linalg.svd((reference - mean_r).T @ (estimate - mean_e))
    sign = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ sign @ vt
    return rotation, mean_r - rotation @ mean_e


def pair_up(times, positions, truth_path):
    """Indices of pairs and the reference's positions, all poses."""
    truth_times, truth = read_positions(truth_path)
    if truth_times is None:
        if len(truth) != len(positions):
            raise InputError(f"{truth_path}: {len(truth)} poses, the run has {len(positions)}")
        every = np.arange(len(positions))
        return every, every, truth
    ours, theirs = associate(times, truth_times)
    if len(ours) < 3:
        raise InputError(f"{truth_path}: only {len(ours)} poses at the times of the run")
    inside = (truth_times >= times[0] - 1.0) & (truth_times <= times[-1] + 1.0)
    shift = np.cumsum(inside) - 1
    return ours, shift[theirs], truth[inside]


def read_objects(path):
    """Paths (N x 3, m) of moving objects by instance, in order of time; none without the file."""
    paths = {}
    try:
        with open(path, encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                place = [float(row[axis]) for axis in "xyz"]
                if not np.isfinite(place).all():
                    raise ValueError
                paths.setdefault(int(row["instance"]), []).append(place)
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except (KeyError, TypeError, ValueError, csv.Error):
        raise InputError(f"{path}: not a table of objects") from None
    return {name: np.array(places) for name, places in paths.items()}


def read_summary(run):
    try:
        with open(os.path.join(run, "summary.json"), encoding="utf-8") as file:
            summary = json.load(file)
        return summary if isinstance(summary, dict) else {}
    except (OSError, ValueError, RecursionError):  # the last: nested too deeply
        return {}


def draw_view(axes, estimate, truth, objects, plane):
    a, b = {"xz": (0, 2), "xy": (0, 1)}[plane]
    label = "moving objects"
    for path in objects:
        axes.plot(path[:, a], path[:, b], color="C1", lw=0.9, alpha=0.8, label=label)
        axes.plot(*path[-1, [a, b]], ".", color="C1", ms=4)
        label = None
    if truth is not None:
        axes.plot(truth[:, a], truth[:, b], color="0.55", lw=1.5, label="ground truth")
    axes.plot(estimate[:, a], estimate[:, b], color="C0", lw=1.2, label="estimate")
    axes.plot(*estimate[0, [a, b]], "o", color="C2", ms=5, label="start")
    axes.plot(*estimate[-1, [a, b]], "s", color="C3", ms=5, label="end")
    axes.set_xlabel(f"{plane[0]} [m]")
    axes.set_ylabel(f"{plane[1]} [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)


def draw(run, times, positions, truth_path, plane):
    summary = read_summary(run)
    title = label_of(run)
    objects = list(read_objects(os.path.join(run, "objects.csv")).values())
    if "mode" in summary:
        title += f"  (mode {readable(str(summary['mode']))})"
    if truth_path is None:
        figure, axes = plt.subplots(figsize=(7, 6), layout="constrained")
        draw_view(axes, positions, None, objects, plane)
        axes.set_title(title)
        return figure
    ours, theirs, truth = pair_up(times, positions, truth_path)
    rotation, shift = align(positions[ours], truth[theirs])
    aligned = positions @ rotation.T + shift
    errors = np.linalg.norm(aligned[ours] - truth[theirs], axis=1)
    rmse = float(np.sqrt((errors**2).mean()))
    figure, (view, curve) = plt.subplots(1, 2, figsize=(12, 5.5), layout="constrained")
    objects = [path @ rotation.T + shift for path in objects]
    draw_view(view, aligned, truth, objects, plane)
    view.set_title(title)
    curve.plot(times[ours] - times[0], errors, color="C0", lw=1)
    curve.axhline(rmse, color="C3", lw=1, ls="--", label=f"RMSE {rmse:.3f} m")
    curve.set_ylim(bottom=0)
    curve.set_xlabel("time [s]")
    curve.set_ylabel("position error [m]")
    curve.set_title("after SE(3) alignment")
    curve.grid(alpha=0.3)
    curve.legend(fontsize=8)
    return figure


def save(figure, path):
    folder = os.path.dirname(os.path.abspath(path))
    try:
        handle, temporary = tempfile.mkstemp(dir=folder, suffix=".png")
        os.close(handle)
        try:
            figure.savefig(temporary, dpi=130, metadata={"Software": None})
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", help="output folder of a run")
    parser.add_argument("--ground-truth", metavar="FILE",
                        help="default: RUN/ground_truth.tum if it exists")
    parser.add_argument("--output", metavar="FILE", help="default: RUN/trajectory.png")
    parser.add_argument("--plane", choices=["xz", "xy"], default="xz",
                        help="axes of the view from above (default: xz; EuRoC: xy)")
    arguments = parser.parse_args()
    output = arguments.output or os.path.join(arguments.run, "trajectory.png")
    truth = arguments.ground_truth
    beside = os.path.join(arguments.run, "ground_truth.tum")
    if truth is None and os.path.exists(beside):
        truth = beside
    times, positions = read_positions(os.path.join(arguments.run, "trajectory.tum"))
    if times is None:
        raise InputError(f"{arguments.run}/trajectory.tum: no time stamps")
    save(draw(arguments.run, times, positions, truth, arguments.plane), output)
    print(readable(output))
    return 0


if __name__ == "__main__":
    run_tool(main)
