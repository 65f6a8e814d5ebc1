#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws several runs of one sequence over its ground truth into one PNG.

    compare_runs.py RUN[=LABEL]... --output FILE [--ground-truth FILE] [--image FILE]

Each RUN is the output folder of a run. Upper picture: distance from the start, which shows a run
that believes it stands still. Lower picture: position error after alignment (SE(3), Umeyama),
logarithmic. Ground truth is FIRST_RUN/ground_truth.tum, or the KITTI or TUM file given. An image of
the sequence, PNG or JPEG, is shown above them.
"""
import argparse
import os

from plot_trajectory import (InputError, align, label_of, pair_up, plt, read_positions, readable,
                             run_tool, save)

import numpy as np
from matplotlib.ticker import FormatStrFormatter


def read_run(argument, truth_path):
    """Label, times (s), distance from the start (m), the truth's, position errors (m)."""
    folder, _, label = argument.partition("=")
    times, positions = read_positions(os.path.join(folder, "trajectory.tum"))
    ours, theirs, truth = pair_up(times, positions, truth_path)
    rotation, translation = align(positions[ours], truth[theirs])
    error = np.linalg.norm(positions[ours] @ rotation.T + translation - truth[theirs], axis=1)
    away = np.linalg.norm(positions[ours] - positions[ours[0]], axis=1)
    truth_away = np.linalg.norm(truth[theirs] - truth[theirs[0]], axis=1)
    return readable(label) or label_of(folder), times[ours], away, truth_away, error


def read_image(path):
    try:
        return plt.imread(path)
    except (OSError, ValueError, SyntaxError):  # the last: PNG files that are damaged
        raise InputError(f"{path}: cannot be read as an image") from None


def make_figure(image):
    """A figure with the image above two axes, which are returned too."""
    if image is None:
        return plt.subplots(2, 1, sharex=True, figsize=(7, 5))
    above = 7 * image.shape[0] / image.shape[1]  # inches
    figure, axes = plt.subplots(3, 1, figsize=(7, 5 + above), height_ratios=(above, 2.5, 2.5))
    axes[0].imshow(image, cmap="gray")
    axes[0].set_axis_off()
    axes[1].sharex(axes[2])
    axes[1].tick_params(labelbottom=False)
    return figure, axes[1:]


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", metavar="RUN[=LABEL]")
    parser.add_argument("--output", required=True, metavar="FILE")
    parser.add_argument("--ground-truth", metavar="FILE")
    parser.add_argument("--image", metavar="FILE")
    arguments = parser.parse_args()
    truth = arguments.ground_truth or os.path.join(arguments.runs[0].partition("=")[0],
                                                   "ground_truth.tum")
    runs = [read_run(run, truth) for run in arguments.runs]
    figure, (upper, lower) = make_figure(read_image(arguments.image) if arguments.image else None)
    upper.plot(runs[0][1], runs[0][3], color="0.5", linewidth=3, label="ground truth")
    for label, times, away, _, error in runs:
        line, = upper.plot(times, away, linewidth=1.3, label=label)
        rmse = np.sqrt(np.mean(error ** 2))
        lower.semilogy(times, np.maximum(error, 1e-4), color=line.get_color(), linewidth=1.3,
                       label=f"ATE {rmse:.3f} m")
    upper.set_ylabel("distance from the start [m]")
    lower.yaxis.set_major_formatter(FormatStrFormatter("%g"))  # not 10^k, a formula
    lower.set_ylabel("position error [m]")
    lower.set_xlabel("time [s]")
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    figure.tight_layout()
    save(figure, arguments.output)
    print(readable(arguments.output))
    return 0


if __name__ == "__main__":
    run_tool(main)
