# SPDX-License-Identifier: BSD-3-Clause
"""Results of a work folder as rows: the labels of a run with its figures."""
import csv
import os
from typing import NamedTuple

from paired import mean
from runs import FAILED, read_json, read_plan

HERE = os.path.dirname(os.path.abspath(__file__))
METRICS = {"ate": ("ATE", "m"), "rpe_m": ("E_t per frame", "m"), "rpe_deg": ("E_R per frame", "deg"),
           "wall_s": ("wall clock", "s"),
           "survival_8": ("keypoints with mu up to 8", "%"),
           "survival_20": ("keypoints with mu up to 20", "%"), "tracked": ("frames tracked", "%")}
ORIGINS = {"given": "given data", "partial": "parts of given sequences",
           "substitute": "simulated substitutes", "simulated": "simulated worlds",
           "drive": "simulated drives"}


class Results:
    def __init__(self, work):
        self.work = os.path.abspath(work)
        self.plan = read_plan(self.work, "scale", "source", "jobs", "given", "experiments")
        self._done = {}

    def done(self, ident):
        if ident not in self._done:
            self._done[ident] = read_json(os.path.join(self.work, "done", ident + ".json")) or {
                "status": "missing", "reason": "not run yet"}
        return self._done[ident]

    def job(self, ident):
        return read_json(os.path.join(self.work, "jobs", ident + ".json"))

    def folder(self, row):
        return os.path.join(self.work, "runs", row["job"])

    def rows(self, experiment):
        """Rows of an experiment's runs; `tracked` in %. What failed tracked nothing, and has no other
        figures."""
        rows = []
        for labels in experiment["runs"]:
            row = {**self.done(labels["job"]), **labels}
            if row.get("frames"):
                row["frames_tracked"], row["tracked"] = row["tracked"], (
                    100.0 * row["tracked"] / row["frames"])
            elif row["status"] == FAILED:
                row["tracked"] = 0.0
            rows.append(row)
        return rows


def published(name):
    """Rows of a file of published figures; values are numbers."""
    path = os.path.join(HERE, "published", name)
    with open(path, encoding="utf-8", newline="") as file:
        return [{**row, "value": float(row["value"])} for row in csv.DictReader(file)]


def unique(rows, key):
    """Values of a label in the order of their first appearance."""
    return list(dict.fromkeys(row[key] for row in rows))


def select(rows, **labels):
    return [r for r in rows if all(r.get(k) == v for k, v in labels.items())]


def over_repeats(rows, metric):
    """Runs that differ in their repeat alone become one: {(input, seed, case, ...): mean}."""
    groups = {}
    for r in rows:
        key = tuple(r[k] for k in ("input", "seed", "case", "variant", "schedule"))
        groups.setdefault(key, []).append(r.get(metric))
    return {key: mean(values) for key, values in groups.items()}


class Pairs(NamedTuple):
    """What was run under both of two configurations, as keys (input, seed, case, ...)."""

    keys: list  # with a result of both
    baseline: list  # values, in the order of `keys`
    values: list
    lost: list  # keys without a result, where the baseline has one or the run failed
    lost_baseline: list  # the other way round

    @property
    def without_result(self):
        """How many, and how many of the baseline, as text."""
        return f"{len(self.lost)} ({len(self.lost_baseline)})"


def pairs(baseline_rows, rows, metric, ignore=()):
    """Pairs of two configurations; `ignore`: labels that may differ. What was not run yet is none."""
    order = ("input", "seed", "case", "variant", "schedule")
    strip = lambda key: tuple(v for k, v in zip(order, key) if k not in ignore)
    sides = []
    for side in (baseline_rows, rows):
        side = [r for r in side if r.get("status") != "missing"]
        broken = over_repeats([r for r in side if r.get("status") in (FAILED, "lost")], metric)
        sides.append((over_repeats(side, metric), broken))
    first, first_broken = ({strip(k): v for k, v in values.items()} for values in sides[0])
    found = Pairs([], [], [], [], [])
    for key, value in sides[1][0].items():
        same = strip(key)
        if same not in first:
            continue
        other = first[same]
        if value is not None and other is not None:
            found.keys.append(key)
            found.baseline.append(other)
            found.values.append(value)
        if value is None and (other is not None or key in sides[1][1]):
            found.lost.append(key)
        if other is None and (value is not None or same in first_broken):
            found.lost_baseline.append(key)
    return found
