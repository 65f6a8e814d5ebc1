# SPDX-License-Identifier: BSD-3-Clause
"""The table of tools/recordings.sh: as JSON, as Markdown, as a part of a page, and compared with a stored
one."""
import csv
import json
import os

from runs import write_text
from inputs import fail, reading  # runs knows where it is
from tables import Table

BEGIN, END = "<!-- made by tools/recordings.sh -->", "<!-- end -->"
SAME, DIFFERS, ABSENT, NEW = "same", "differs", "no such recording here", "not stored"
# What the same program gives again on the same input, whatever the machine is doing.
REPRODUCED = ("input", "trajectory", "frames", "connected", "keyframes", "loops", "flagged", "ate_se3_m",
              "ate_sim3_m", "scale", "segments", "t_rel_percent", "r_rel_deg_per_100m", "error")
COLUMNS = [("recording", "name"), ("schedule", "schedule"), ("part", "part"), ("frames", "frames"),
           ("connected", "connected"), ("ATE SE(3), m", "ate_se3_m"), ("ATE Sim(3), m", "ate_sim3_m"),
           ("scale", "scale"), ("segments, %", "t_rel_percent"),
           ("segments, deg/100 m", "r_rel_deg_per_100m"), ("keyframes", "keyframes"), ("loops", "loops"),
           ("flagged", "flagged"), ("ms per frame", "ms_per_frame"),
           ("processor ms per frame", "cpu_ms_per_frame"), ("memory, MB", "memory_mb"),
           ("trajectory", "trajectory"), ("input", "input")]
PUBLISHED = {"kitti": ("table1.csv", "Table 1"), "euroc": ("table2.csv", "Table 2")}
SYSTEMS = ("ORB-SLAM2", "ORB-SLAM3", "DynaSLAM", "KYS-SLAM")


# --- as Markdown ---------------------------------------------------------------------------------


def _cells(row):
    cells = [row.get(key, "-") for _, key in COLUMNS]
    if "error" in row:
        cells[2] = "failed: " + row["error"]
    return cells


def _ranges(ranges):
    return ", ".join(f"{a} to {b}" for a, b in ranges)


def _remarks(facts, rows):
    """Lines on recordings in the table: notes, frames left out, warnings."""
    lines = {}  # each once, in the order of the rows
    for row in rows:
        name = row["name"]
        if name in facts["notes"]:
            lines[f"- {name}: {facts['notes'][name]}"] = None
        if row.get("frames_left_out"):
            lines[f"- {name}: frames {_ranges(row['frames_left_out'])} of the ground truth are wrong and "
                  "left out of all figures."] = None
        if row.get("frames_left_out_of_segments"):
            lines[f"- {name}: segments leave out frames "
                  f"{_ranges(row['frames_left_out_of_segments'])}."] = None
        if "warning" in row:
            lines[f"- {name}, {row['schedule']}: {row['warning']}"] = None
    return "\n".join(lines)


def _published(name):
    """(system, ATE in m, source) of a whole sequence in the paper's tables."""
    table = PUBLISHED.get(name.partition("/")[0])
    if table is None:
        return []
    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "published", table[0])
    with reading(path), open(path, encoding="utf-8", newline="") as file:
        return [(row["method"] + (" (paper)" if row["method"] == "KYS-SLAM" else ""), row["value"],
                 f"{table[1]} of the paper") for row in csv.DictReader(file)
                if row["sequence"] == name and row["metric"] == "ate" and row["method"] in SYSTEMS]


def _others(facts, rows):
    """The table of other systems on the recordings that are in the rows, or None."""
    lines = []
    for name in dict.fromkeys(row["name"] for row in rows):
        mine = [row for row in rows if row["name"] == name and "ate_se3_m" in row]
        for other in facts["others"].get(name, []):
            lines.append([name, other["system"], other["ate_se3_m"], other.get("ate_sim3_m", "-"),
                          other["source"]])
        if any(row["part"] == "complete" for row in mine):
            lines += [[name, system, ate, "-", source] for system, ate, source in _published(name)]
    if not lines:
        return None
    return Table("others", "Other systems on the same frames",
                 ["recording", "system", "ATE SE(3), m", "ATE Sim(3), m", "source"], lines)


def markdown(facts, rows):
    versions = next((row["versions"] for row in rows if "versions" in row), {})
    said = ", ".join(f"{key.replace('_', ' ')} {value}" for key, value in versions.items())
    table = Table("recordings", "Recordings", [title for title, _ in COLUMNS], [_cells(r) for r in rows])
    others = _others(facts, rows)
    return "\n".join(filter(None, [table.markdown(), f"Versions: {said}.\n" if said else "",
                                   _remarks(facts, rows) + "\n" if _remarks(facts, rows) else "",
                                   others.markdown() if others else ""]))


# --- files ---------------------------------------------------------------------------------------


def split_page(path):
    """What comes before and after the part between the markers, these included."""
    with reading(path), open(path, encoding="utf-8") as file:
        text = file.read()
    if text.count(BEGIN) != 1 or END not in text.partition(BEGIN)[2]:
        fail(f"{path}: needs one pair of markers: {BEGIN} and {END}")
    before, _, rest = text.partition(BEGIN)
    return before + BEGIN + "\n", END + rest.partition(END)[2]


def write(folder, facts, rows, page=None, table=None):
    """table.json and table.md in a folder; the page's part between its markers; the JSON elsewhere."""
    text = json.dumps({"rows": rows}, indent=1) + "\n"
    os.makedirs(folder, exist_ok=True)
    write_text(os.path.join(folder, "table.json"), text)
    write_text(os.path.join(folder, "table.md"), markdown(facts, rows))
    if table:
        write_text(table, text)
    if page:
        before, after = split_page(page)
        write_text(page, before + "\n" + markdown(facts, rows) + "\n" + after)


def read(path):
    """Rows of a stored table."""
    with reading(path), open(path, encoding="utf-8") as file:
        rows = json.load(file)["rows"]
        for row in rows:
            if not all(isinstance(row[key], str) for key in ("name", "schedule")):
                fail(f"{path}: a row without name or schedule")
        return rows


# --- comparison ----------------------------------------------------------------------------------


def compare(stored, rows):
    """(verdict, line) of every stored row, then of rows that are not stored. A stored row is found again by
    its input, wherever that is; else by its name."""
    verdicts, used = [], set()
    for row in stored:
        alike = [r for r in rows if r["schedule"] == row["schedule"] and id(r) not in used]
        mine = next((r for r in alike if "input" in row and r.get("input") == row["input"]
                     and r.get("kind") == row.get("kind")), None)
        mine = mine or next((r for r in alike if r["name"] == row["name"]), None)
        verdict, why = ABSENT, ""
        if mine is not None:
            used.add(id(mine))
            changes = [f"{key} {mine.get(key, '-')}, stored {row.get(key, '-')}" for key in REPRODUCED
                       if mine.get(key) != row.get(key)]
            verdict, why = (DIFFERS, ": " + "; ".join(changes)) if changes else (SAME, "")
        verdicts.append((verdict, f"{row['name']}, {row['schedule']}: {verdict}{why}"))
    verdicts += [(NEW, f"{r['name']}, {r['schedule']}: {NEW}") for r in rows if id(r) not in used]
    return verdicts
