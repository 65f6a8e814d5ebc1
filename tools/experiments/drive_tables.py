"""Tables of drives with traffic, from the rows of their runs."""
import csv
import math

import numpy as np
from scipy import stats

from runs import InputError  # first: it knows where inputs is
from inputs import reading
from paired import CONFIDENCE, difference, mean
from tables import Table, show

RUN_HEADER = ["sequence", "traffic", "perception", "mode", "seed", "frames", "lost", "ATE m",
              "E_t %", "E_R deg/100m", "RPE m", "loops", "keyframes", "sub-maps", "mover share", "failed"]
LABELS = RUN_HEADER[:5]
HEADER = ["sequence", "traffic", "perception", "mode", "seeds", "ATE m", "less stock, m", "E_t %",
          "E_R deg/100m", "frames lost", "loops", "failed"]
RATIO_HEADER = ["data", "traffic", "perception", "mode", "runs", "ATE m", "largest m", "pairs",
                "over stock", "95 %", "pairs", "over mask", "95 %", "E_t %", "E_R deg/100m",
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
            rows.append(line[:5] + [number(v) for v in line[5:-1]] + line[-1:])
        return rows


def join_runs(rows, others):
    """`rows`, and those of `others` whose labels they do not have."""
    known = {tuple(r[:5]) for r in rows}
    joined = list(rows)
    for row in others:
        if tuple(row[:5]) not in known:
            known.add(tuple(row[:5]))
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


def sequence_table(rows):
    """One line per sequence, traffic, perception and mode."""
    groups, stock = {}, {}
    for row in rows:
        groups.setdefault(tuple(row[:4]), []).append(row)
        if row[3] == "stock":
            stock[(row[0], row[1], row[4])] = row[7]
    lines = []
    for (sequence, traffic, perception, mode), group in groups.items():
        less = [r[7] - stock[(sequence, traffic, r[4])] for r in group
                if r[7] is not None and stock.get((sequence, traffic, r[4])) is not None]
        lines.append([sequence, traffic, "-" if mode == "stock" else perception, mode, len(group),
                      show(mean([r[7] for r in group]), 3),
                      "" if mode == "stock" else interval(less),
                      show(mean([r[8] for r in group]), 3), show(mean([r[9] for r in group]), 3),
                      *(sum(r[k] or 0 for r in group) for k in (6, 11)),
                      sum(bool(r[15]) for r in group)])
    return Table("drives", "Drives with traffic, simulated features", HEADER, lines)


def ratio(group, others):
    """Pairs, geometric mean of ATE over that of the run of `others` with the same key, interval.
    `others`: ATE by key; `group`: (key, ATE)."""
    logs = [math.log(ate / others[key]) for key, ate in group if ate and others.get(key)]
    d = difference(np.zeros(len(logs)), logs)
    form = lambda v: show(math.exp(v), 2)
    return [d.pairs, "-" if d.mean is None else form(d.mean),
            "-" if d.low is None else f"{form(d.low)} to {form(d.high)}"]


def ratio_table(rows):
    """One line per data set, traffic, perception and mode: ATE over that of `stock` and of `mask`
    on the same sequence, traffic, seed (and perception)."""
    data = lambda row: "KITTI" if row[0].isdigit() else "EuRoC"
    groups, stock, mask = {}, {}, {}
    for row in rows:
        sequence, traffic, perception, mode, seed = row[:5]
        groups.setdefault((data(row), traffic, "-" if mode == "stock" else perception, mode),
                          []).append(row)
        if mode == "stock":
            stock[(sequence, traffic, seed)] = row[7]
        elif mode == "mask":
            mask[(sequence, traffic, perception, seed)] = row[7]
    lines = []
    for (name, traffic, perception, mode), group in groups.items():
        ates = [r[7] for r in group if r[7] is not None]
        frames = sum(r[5] or 0 for r in group)
        none = [0, "", ""]
        lines.append([
            name, traffic, perception, mode, len(group), show(mean(ates), 3),
            show(max(ates) if ates else None, 3),
            *(none if mode == "stock" else ratio([((r[0], r[1], r[4]), r[7]) for r in group], stock)),
            *(none if mode in ("stock", "mask") else
              ratio([((r[0], r[1], r[2], r[4]), r[7]) for r in group], mask)),
            show(mean([r[8] for r in group]), 3), show(mean([r[9] for r in group]), 3),
            show(100 * sum(r[6] or 0 for r in group) / frames if frames else None, 2),
            sum(bool(r[15]) for r in group)])
    return Table("drives-ratios", "Drives with traffic: ATE over that of other modes", RATIO_HEADER,
                 lines)
