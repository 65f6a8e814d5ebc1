#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Tables of drives with traffic, from the rows of their runs.

    drive_tables.py DRIVES_CSV [DRIVES_CSV...]

prints the tables of runs that drives.py made: errors over those of `stock` and of `mask`, modes side by
side, and the same with a free scale. Of a run that is in several files the first one counts.
"""
import argparse
import csv
import math
from typing import NamedTuple

import numpy as np
from scipy import stats

from runs import InputError  # first: it knows where inputs is
from inputs import reading, run
from paired import CONFIDENCE, difference, mean
from tables import Table, show


class Run(NamedTuple):
    """One row of drives.csv. Text but for the figures; those are None where there are none."""

    sequence: str
    traffic: str
    perception: str
    mode: str
    seed: str
    frames: int | None = None
    lost: int | None = None  # frames
    ate: float | None = None  # m, after alignment in SE(3)
    ate_sim3: float | None = None  # m, with a free scale too
    scale: float | None = None  # of that alignment
    e_t: float | None = None  # %
    e_r: float | None = None  # deg per 100 m
    rpe: float | None = None  # m
    loops: int | None = None
    keyframes: int | None = None
    submaps: int | None = None
    mover_share: float | None = None  # % of the image
    failed: str = ""  # why

    @property
    def data(self):
        return "KITTI" if self.sequence.isdigit() else "EuRoC"


LABELS = 5  # columns
RUN_HEADER = ["sequence", "traffic", "perception", "mode", "seed", "frames", "lost", "ATE m",
              "ATE Sim(3) m", "scale", "E_t %", "E_R deg/100m", "RPE m", "loops", "keyframes", "sub-maps",
              "mover share", "failed"]
HEADER = ["sequence", "traffic", "perception", "mode", "seeds", "ATE m", "less stock, m", "ATE Sim(3) m",
          "E_t %", "E_R deg/100m", "frames lost", "loops", "failed"]
RATIO_HEADER = ["data", "traffic", "perception", "mode", "runs", "ATE m", "largest m", "over stock",
                "over mask", "ATE Sim(3) m", "over stock", "over mask", "E_t %", "E_R deg/100m",
                "frames lost %", "failed"]


def run_table(rows):
    """All runs; a row has the columns of RUN_HEADER."""
    text = lambda v: f"{v:.6g}" if isinstance(v, float) else "" if v is None else v
    return Table("drives", "Runs", RUN_HEADER, [list(map(text, r)) for r in rows])


def read_runs(path):
    """Rows of a file that run_table(...).comma_separated() wrote."""
    def number(text):
        if text == "":
            return None
        value = float(text)
        if not math.isfinite(value):
            raise ValueError(f"'{text}' is not finite")
        return int(value) if value.is_integer() and "." not in text else value

    with reading(path), open(path, encoding="utf-8", newline="") as file:
        lines = list(csv.reader(file))
        if not lines or lines[0] != RUN_HEADER:
            raise InputError(f"{path}: not a table of runs (drives.csv)")
        rows = []
        for line in lines[1:]:
            if len(line) != len(RUN_HEADER):
                raise InputError(f"{path}: row {len(rows) + 2} has {len(line)} columns, not "
                                 f"{len(RUN_HEADER)}")
            rows.append(Run(*line[:LABELS], *map(number, line[LABELS:-1]), line[-1]))
        return rows


def join_runs(rows, others):
    """`rows`, and those of `others` whose labels they do not have."""
    known = {r[:LABELS] for r in rows}
    joined = list(rows)
    for row in others:
        if row[:LABELS] not in known:
            known.add(row[:LABELS])
            joined.append(row)
    return joined


def interval(values):
    """Mean with its 95 % confidence interval; of one value: the value."""
    if not values:
        return "-"
    if len(values) == 1:
        return f"{values[0]:+.3f}"
    half = stats.t.ppf((1 + CONFIDENCE) / 2, len(values) - 1) * np.std(values, ddof=1) / math.sqrt(
        len(values))
    return f"{np.mean(values):+.3f} +- {half:.3f}"


def grouped(rows, key):
    """Rows by key, in the order in which the keys appear."""
    groups = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return groups


class Reference:
    """The runs of one mode, found by the input that another run has in common with them."""

    def __init__(self, rows, mode):
        self.any_priors = mode == "stock"  # it reads none
        self.runs = {self.key(r): r for r in rows if r.mode == mode}

    def key(self, run):
        return (run.sequence, run.traffic, "" if self.any_priors else run.perception, run.seed)

    def pairs(self, group, error):
        """`error` of a run and of this mode's, of every pair that has both."""
        pairs = [(getattr(r, error), getattr(self.runs.get(self.key(r)), error, None)) for r in group]
        return [(a, b) for a, b in pairs if a is not None and b is not None]

    def ratio(self, group, error):
        """Geometric mean of the ratio, with its interval; the number of pairs unless all have both."""
        logs = [math.log(a / b) for a, b in self.pairs(group, error) if a and b]
        d = difference(np.zeros(len(logs)), logs)
        if d.mean is None:
            return "-"
        form = lambda v: show(math.exp(v), 2)
        text = form(d.mean) if d.low is None else f"{form(d.mean)} ({form(d.low)}-{form(d.high)})"
        return text if len(logs) == len(group) else f"{text}, {len(logs)} of {len(group)} pairs"


def means(rows, *names):
    return [show(mean([getattr(r, name) for r in rows]), 3) for name in names]


def sequence_table(rows):
    """One line per sequence, traffic, perception and mode."""
    stock = Reference(rows, "stock")
    lines = []
    for labels, group in grouped(rows, lambda r: r[:LABELS - 1]).items():
        less = [a - b for a, b in stock.pairs(group, "ate")]
        lines.append([*labels[:2], "-" if labels[3] == "stock" else labels[2], labels[3], len(group),
                      *means(group, "ate"), "" if labels[3] == "stock" else interval(less),
                      *means(group, "ate_sim3", "e_t", "e_r"), sum(r.lost or 0 for r in group),
                      sum(r.loops or 0 for r in group), sum(bool(r.failed) for r in group)])
    return Table("drives", "Drives with traffic, simulated features", HEADER, lines)


def ratio_table(rows):
    """One line per data set, traffic, perception and mode: errors over those of `stock` and of `mask`
    on the same sequence, traffic, seed (and perception)."""
    stock, mask = Reference(rows, "stock"), Reference(rows, "mask")
    key = lambda r: (r.data, r.traffic, "-" if r.mode == "stock" else r.perception, r.mode)
    lines = []
    for (*labels, mode), group in grouped(rows, key).items():
        ratios = lambda error: ["" if mode == "stock" else stock.ratio(group, error),
                                "" if mode in ("stock", "mask") else mask.ratio(group, error)]
        largest = max((r.ate for r in group if r.ate is not None), default=None)
        frames = sum(r.frames or 0 for r in group)
        lost = 100 * sum(r.lost or 0 for r in group) / frames if frames else None
        lines.append([*labels, mode, len(group), *means(group, "ate"), show(largest, 3), *ratios("ate"),
                      *means(group, "ate_sim3"), *ratios("ate_sim3"), *means(group, "e_t", "e_r"),
                      show(lost, 2), sum(bool(r.failed) for r in group)])
    return Table("drives-ratios", "Drives with traffic: errors over those of other modes", RATIO_HEADER,
                 lines, "Geometric means of the ratios of all pairs; 95 % by bootstrap over pairs.")


def mode_table(rows, error="ate"):
    """Modes side by side: their mean error, m, by data set, traffic and perception. `verified`, where
    it ran, over `stock` and over `mask`; beside the ATE also with a free scale."""
    modes = list(grouped(rows, lambda r: r.mode))
    stock, mask = Reference(rows, "stock"), Reference(rows, "mask")
    perceptions = list(grouped((r for r in rows if r.mode != "stock"), lambda r: r.perception))
    errors = ["ate", "ate_sim3"] if error == "ate" else [error]
    lines = []
    for (data, traffic), group in grouped(rows, lambda r: (r.data, r.traffic)).items():
        for perception in perceptions:
            of = lambda mode: [r for r in group
                               if r.mode == mode and (mode == "stock" or r.perception == perception)]
            verified = of("verified")
            lines.append([data, traffic, perception, *(means(of(m), error)[0] for m in modes),
                          *(r.ratio(verified, e) for e in errors for r in (stock, mask))])
    name = {"ate": "ATE", "ate_sim3": "ATE with a free scale"}[error]
    return Table("drives-modes" + ("" if error == "ate" else "-sim3"),
                 f"Drives with traffic: mean {name}, m, of all modes",
                 ["data", "traffic", "priors", *modes, "verified over stock", "over mask",
                  *(["free scale: over stock", "over mask"] if error == "ate" else [])], lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", metavar="DRIVES_CSV")
    rows = []
    for path in parser.parse_args().runs:
        rows = join_runs(rows, read_runs(path))
    for table in (ratio_table(rows), mode_table(rows), mode_table(rows, "ate_sim3")):
        print(table.markdown())
    return 0


if __name__ == "__main__":
    run(main)
