# SPDX-License-Identifier: BSD-3-Clause
"""Figures of an experiment, with matplotlib, as PNG files."""
import os
import sys

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import matplotlib.ticker  # noqa: E402  (the backend comes first)

from results import select, unique  # noqa: E402

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "plots"))
import plot_trajectory  # noqa: E402

WIDTH = 9.0  # inches
COLOURS = ["#4269d0", "#efb118", "#ff725c", "#6cc5b0", "#3ca951", "#ff8ab7", "#a463f2", "#97bbf5",
           "#9c6b4e", "#9498a0"]


def save(figure, path):
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path


def log_axis(axis):
    """A logarithmic axis with plain numbers, also where it spans less than a decade."""
    axis.axes.set_yscale("log")
    plain = matplotlib.ticker.FuncFormatter(lambda value, _: f"{value:.3g}")
    low, high = axis.get_view_interval()
    axis.set_major_formatter(plain)
    axis.set_minor_formatter(plain if high < 10 * low else matplotlib.ticker.NullFormatter())
    if high < 10 * low:
        axis.set_minor_locator(matplotlib.ticker.MaxNLocator(4))
        axis.set_major_locator(matplotlib.ticker.NullLocator())
    axis.set_tick_params(which="both", labelsize=7)


def boxes(rows, groups, columns, metric_label, title, path, metric="ate"):
    """One panel of boxes per value of `groups`; a box per value of `columns`, a point per run."""
    names = [g for g in unique(rows, groups)
             if any(r.get(metric) is not None for r in select(rows, **{groups: g}))]
    if not names:
        return None
    across = min(3, len(names))
    down = -(-len(names) // across)
    figure, axes = plt.subplots(down, across, figsize=(WIDTH, 2.7 * down), squeeze=False)
    labels = unique(rows, columns)
    for axis, name in zip(axes.flat, names):
        data = [[r[metric] for r in select(rows, **{groups: name, columns: c})
                 if r.get(metric) is not None] for c in labels]
        shown = [(c, d) for c, d in zip(labels, data) if d]
        if any(len(d) > 1 for _, d in shown):
            axis.boxplot([d for _, d in shown], showfliers=False, widths=0.6,
                         medianprops={"color": "black"})
        axis.set_xlim(0.5, len(shown) + 0.5)
        for i, (c, d) in enumerate(shown):
            axis.scatter(np.full(len(d), i + 1), d, s=14, zorder=3,
                         color=COLOURS[labels.index(c) % len(COLOURS)])
        axis.set_xticks(range(1, len(shown) + 1), [c for c, _ in shown], rotation=50, ha="right",
                        fontsize=7)
        log_axis(axis.yaxis)
        axis.set_title(str(name), fontsize=9)
        axis.grid(axis="y", alpha=0.3)
    for axis in list(axes.flat)[len(names):]:
        axis.set_visible(False)
    axes[0][0].set_ylabel(metric_label, fontsize=8)
    figure.suptitle(title, fontsize=10)
    return save(figure, path)


def sweep(rows, values, baseline, published, title, path):
    """ATE over the values of a sweep, a line per input (mean over seeds), the baseline dashed, the
    published figures in a panel of their own."""
    figure, axes = plt.subplots(1, 2 if published else 1, figsize=(WIDTH, 3.2), squeeze=False)
    for k, name in enumerate(unique(rows, "input")):
        means = []
        for v in values:
            found = [r["ate"] for r in select(rows, input=name, configuration=v)
                     if r.get("ate") is not None]
            means.append(np.mean(found) if found else np.nan)
        colour = COLOURS[k % len(COLOURS)]
        axes[0][0].plot(range(len(values)), means, "o-", color=colour, label=name, markersize=4)
        base = [r["ate"] for r in select(rows, input=name, configuration=baseline)
                if r.get("ate") is not None]
        if base:
            axes[0][0].axhline(np.mean(base), color=colour, linestyle=":", linewidth=1)
    axes[0][0].set_title("ours (dotted: stock)", fontsize=9)
    if published:
        for k, name in enumerate(unique(published, "sequence")):
            mine = {r["setting"]: r["value"] for r in select(published, sequence=name)}
            axes[0][1].plot(range(len(values)), [mine.get(v, np.nan) for v in values], "s-",
                            color=COLOURS[k % len(COLOURS)], label=name, markersize=4)
        axes[0][1].set_title("published, real recordings", fontsize=9)
    for axis in axes[0]:
        axis.set_xticks(range(len(values)), values, rotation=30, ha="right", fontsize=7)
        axis.set_ylabel("ATE, m", fontsize=8)
        if any(np.nanmax(line.get_ydata(), initial=0) > 0 for line in axis.lines):
            log_axis(axis.yaxis)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    figure.suptitle(title, fontsize=10)
    return save(figure, path)


def aligned(folder):
    """Times (s), aligned estimate and truth (N x 3, m) of a run; the whole truth (M x 3, m)."""
    times, positions = plot_trajectory.read_positions(os.path.join(folder, "trajectory.tum"))
    truth_times, truth = plot_trajectory.read_positions(os.path.join(folder, "ground_truth.tum"))
    ours, theirs = plot_trajectory.associate(times, truth_times)
    if len(ours) < 3:
        raise plot_trajectory.InputError(f"{folder}: fewer than three poses with ground truth")
    rotation, shift = plot_trajectory.align(positions[ours], truth[theirs])
    return times[ours], positions[ours] @ rotation.T + shift, truth[theirs], truth


def plane_of(truth):
    """The two axes along which a path is longest; x and z (from above, of a camera) where the second
    is no longer than what a straight road leaves."""
    spread = np.ptp(truth, axis=0)
    order = np.argsort(spread)
    if spread[order[1]] < 0.02 * spread[order[2]]:
        return 0, 2
    return tuple(sorted(int(i) for i in order[1:]))


def trajectories(runs, title, path):
    """Trajectories over ground truth from above, and the error over time. `runs`: (label, folder)."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(WIDTH, 3.6))
    drawn = False
    for k, (label, folder) in enumerate(runs):
        try:
            times, estimate, truth, whole = aligned(folder)
        except (plot_trajectory.InputError, OSError, ValueError):
            continue
        if not drawn:
            a, b = plane_of(whole)
            left.plot(whole[:, a], whole[:, b], color="black", linewidth=3, alpha=0.3,
                      label="ground truth")
            left.set_xlabel(f"{'xyz'[a]}, m", fontsize=8)
            left.set_ylabel(f"{'xyz'[b]}, m", fontsize=8)
        drawn = True
        colour = COLOURS[k % len(COLOURS)]
        left.plot(estimate[:, a], estimate[:, b], color=colour, linewidth=1, label=label)
        right.plot(times - times[0], np.linalg.norm(estimate - truth, axis=1), color=colour,
                   linewidth=1, label=label)
    if not drawn:
        plt.close(figure)
        return None
    left.set_aspect("equal", adjustable="datalim")
    left.legend(fontsize=7)
    right.set_xlabel("time, s", fontsize=8)
    right.set_ylabel("distance from the truth, m", fontsize=8)
    log_axis(right.yaxis)
    right.grid(alpha=0.3)
    figure.suptitle(title, fontsize=10)
    return save(figure, path)


def over_frames(curves, ylabel, title, path):
    """A value per frame, `curves`: (label, values)."""
    figure, axis = plt.subplots(figsize=(WIDTH, 3.2))
    for k, (label, values) in enumerate(curves):
        axis.plot(values, color=COLOURS[k % len(COLOURS)], linewidth=1, label=label)
    axis.set_xlabel("frame", fontsize=8)
    axis.set_ylabel(ylabel, fontsize=8)
    axis.grid(alpha=0.3)
    axis.legend(fontsize=7)
    figure.suptitle(title, fontsize=10)
    return save(figure, path)


def cumulative(curves, gates, xlabel, title, path):
    """Cumulative distributions, `curves`: (label, values); the gates as vertical lines."""
    curves = [(label, values) for label, values in curves if len(values) > 0]
    if not curves:
        return None
    figure, axis = plt.subplots(figsize=(WIDTH, 3.2))
    for k, (label, values) in enumerate(curves):
        values = np.sort(values)
        axis.plot(values, 100 * np.arange(1, len(values) + 1) / len(values),
                  color=COLOURS[k % len(COLOURS)], label=label)
    for gate in gates:
        axis.axvline(gate, color="black", linestyle=":", linewidth=1)
    axis.set_xlabel(xlabel, fontsize=8)
    axis.set_ylabel("share not above, %", fontsize=8)
    axis.grid(alpha=0.3)
    axis.legend(fontsize=7)
    figure.suptitle(title, fontsize=10)
    return save(figure, path)
