# SPDX-License-Identifier: BSD-3-Clause
"""Reading and writing the class and table files of a label space (formats: kys/README.md)."""

import math
import os
import sys
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "common"))
from inputs import fail, reading  # noqa: E402

COLUMNS = "id,thing,vector,text,name"


@dataclass
class LabelClass:
    id: int
    thing: bool
    vector: str  # "fasttext" or "surrogate"
    text: str  # the words whose vectors are summed
    name: str


def content_lines(path):
    """(number, line) of what is neither empty nor a comment."""
    with reading(path):
        return [
            (number, line.rstrip("\r\n"))
            for number, line in enumerate(Path(path).read_text(encoding="utf-8").splitlines(), 1)
            if line.strip() and not line.startswith("#")
        ]


def read_classes(path):
    """Returns (name of the space, list of LabelClass). InputError naming file and line."""
    lines = content_lines(path)
    if len(lines) < 2:
        fail(f"{path}: empty or truncated")
    head = lines[0][1].split(",")
    if len(head) != 4 or head[0] != "kys-classes" or head[1] != "1" or not head[3].isdecimal():
        fail(f"{path}:{lines[0][0]}: does not begin with 'kys-classes,1,NAME,COUNT'")
    if lines[1][1] != COLUMNS:
        fail(f"{path}:{lines[1][0]}: the second line must be '{COLUMNS}'")
    classes = []
    for number, line in lines[2:]:
        fields = line.split(",", 4)
        if len(fields) != 5 or fields[1] not in ("0", "1"):
            fail(f"{path}:{number}: not a class line ({COLUMNS})")
        with reading(f"{path}:{number}"):
            classes.append(LabelClass(int(fields[0]), fields[1] == "1", *fields[2:]))
    if len(classes) != int(head[3]):
        fail(f"{path}: has {len(classes)} classes, the first line says {head[3]}")
    return head[2], classes


def read_table(path, name, count):
    """Returns the table, a list of rows. InputError naming file and line."""
    lines = content_lines(path)
    if not lines or lines[0][1] != f"kys-table,1,{name},{count}":
        fail(f"{path}: does not begin with 'kys-table,1,{name},{count}'")
    table = []
    for number, line in lines[1:]:
        with reading(f"{path}:{number}"):
            table.append([float(value) for value in line.split(",")])
        if not all(math.isfinite(value) and value >= 0 for value in table[-1]):
            fail(f"{path}:{number}: a distance is negative or not finite")
    if len(table) != count or any(len(row) != count for row in table):
        fail(f"{path}: is not {count} x {count}")
    return table


def write_atomically(path, text):
    temporary = Path(f"{path}.part")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)


def write_classes(path, name, classes, comments=()):
    lines = [f"# {c}" for c in comments]
    lines += [f"kys-classes,1,{name},{len(classes)}", COLUMNS]
    lines += [f"{c.id},{int(c.thing)},{c.vector},{c.text},{c.name}" for c in classes]
    write_atomically(path, "\n".join(lines) + "\n")


def write_table(path, name, table, comments=()):
    lines = [f"# {c}" for c in comments]
    lines.append(f"kys-table,1,{name},{len(table)}")
    lines += [",".join(f"{value:g}" for value in row) for row in table]
    write_atomically(path, "\n".join(lines) + "\n")


def summary(table, names, selection=None):
    """Range and percentiles of the off-diagonal entries, as lines of text."""
    n = len(table)
    chosen = range(n) if selection is None else selection
    pairs = sorted((table[i][j], i, j) for i in chosen for j in chosen if j < i)
    if not pairs:
        return ["a single class: no pairs"]
    values = [p[0] for p in pairs]

    def percentile(q):
        return values[min(len(values) - 1, round(q / 100 * (len(values) - 1)))]

    lines = [
        f"{len(pairs)} pairs, off-diagonal range {values[0]:g}..{values[-1]:g}",
        "percentiles " + ", ".join(f"{q}: {percentile(q):g}" for q in (1, 5, 25, 50, 75, 95, 99)),
    ]
    for title, (value, i, j) in (("closest", pairs[0]), ("farthest", pairs[-1])):
        lines.append(f"{title}: {names[i]} - {names[j]} {value:g}")
    return lines
