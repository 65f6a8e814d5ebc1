# SPDX-License-Identifier: BSD-3-Clause
"""Decisions about moving on real images with real segmentations, against a hand-checked truth.

    evaluate_kitti_06.py PRIORS [PRIORS ...] --classes SPACE.classes.csv [--list]

PRIORS is a folder that build_priors made of the KITTI 06 excerpt (51 frames) with the segments of a
network. In it one car moves, oncoming, frames 22 to 49; everything else is parked. A segment counts
as that car when its horizontal extent covers the car's column and its mean depth is within a factor
of 1.6 of the car's (a segment without depth: its extent decides). Of the false ones those are
counted as well that are a part of the car beside that column: as near to it as half the car is
long. The last frame has no flow and is left out, so are segments of fewer than --min-area px, and
buses and trains, which the networks see in guard rails and walls.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "python" / "kys_slam"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "common"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "semantics"))
import inputs  # noqa: E402
import kysp  # noqa: E402
from label_files import read_classes  # noqa: E402

FIRST, LAST = 22, 49  # frames of the car
# Of the car: column in the left image (px) and depth (m), by frame, linear between.
COLUMN = {18: 490, 24: 452, 36: 367, 38: 340, 40: 310, 42: 273, 43: 250, 44: 220, 45: 187, 46: 150,
          47: 100, 48: 60, 49: 10}
DEPTH = {24: 81, 36: 58, 42: 44.5, 45: 28, 47: 22.7, 49: 18}
BF = 379.8  # px m, focal length times baseline
FOCAL = 707.1  # px
HALF_LENGTH = 2.1  # m, of a car
LAST_FRAME = 50
LEFT_OUT = ("bus", "train")


def frame_name(text):
    int(text)
    return text


def between(table, frame):
    return float(np.interp(frame, list(table), list(table.values())))


def extent(frame, camera, instance):
    """First and last column of a segment, px."""
    priors = frame.cameras[camera]
    for segment in np.flatnonzero(priors.segments["instance"] == instance) + 1:
        columns = np.flatnonzero((priors.segment_map == segment).any(axis=0))
        if len(columns):
            return columns[0], columns[-1]
    raise ValueError(f"has no segment of instance {instance}")


def is_the_car(row, frame, reach=0.0):
    """Does the segment cover the car's column, or come as near to it as `reach` m?"""
    number = int(row["frame"])
    if not FIRST <= number <= LAST:
        return False
    camera = 1 if row["camera"] == "right" else 0
    depth = between(DEPTH, number)
    column = between(COLUMN, number) - (BF / depth if camera else 0)
    first, last = extent(frame, camera, row["identity"])
    mean = row["mean_depth_m"]
    margin = reach * FOCAL / depth
    return bool(first - margin <= column <= last + margin
                and (mean == 0 or max(mean / depth, depth / mean) < 1.6))


def state_of(row):
    if "state" in row:
        return row["state"]
    return "moving" if row["magnitude_test"] == "1" or row["radial_test"] == "1" else "static"


def judged_segments(folder, names, min_area):
    """(row of segments.csv, is it the car, or a part of it) of every segment that counts."""
    folder = Path(folder)
    frames = {}
    columns = {"frame": frame_name, "camera": str, "input_id": str, "part": str, "identity": int,
               "label": lambda text: range(len(names))[int(text)], "area_px": int,
               "mean_depth_m": float, "residual_px": str, "magnitude_test": str, "radial_test": str}
    for row in inputs.read_table(folder / "segments.csv", columns):
        if int(row["frame"]) == LAST_FRAME or row["area_px"] < min_area:
            continue
        if names[row["label"]] in LEFT_OUT:
            continue
        file = folder / (row["frame"] + ".kysp")
        with inputs.reading(file):
            if row["frame"] not in frames:
                frames = {row["frame"]: kysp.read(file)}
            frame = frames[row["frame"]]
            found = row, is_the_car(row, frame), is_the_car(row, frame, HALF_LENGTH)
        yield found


def count(rows, max_depth):
    result = {"true": 0, "missed": 0, "false": 0, "true static": 0, "not judged": 0,
              "near": 0, "near true": 0, "part": 0, "wrong": []}
    for row, moves, part in rows:
        flagged = state_of(row) == "moving"
        result["not judged"] += state_of(row) == "not_judged"
        kind = ("true" if flagged else "missed") if moves else ("false" if flagged else "true static")
        result[kind] += 1
        result["part"] += kind == "false" and part
        if kind in ("missed", "false"):
            note = " (a part of the car)" if part and flagged else ""
            result["wrong"].append((kind + note, row))
        if moves and between(DEPTH, int(row["frame"])) <= max_depth:
            result["near"] += 1
            result["near true"] += flagged
    return result


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("priors", nargs="+")
    parser.add_argument("--classes", required=True, help="class file of the label space")
    parser.add_argument("--min-area", type=inputs.whole(0), default=200, help="px")
    parser.add_argument("--max-depth", type=float, default=45.0, help="m, of the car")
    parser.add_argument("--list", action="store_true", help="every wrong decision")
    parser.add_argument("--table", help="file to write the truth of one PRIORS to (CSV), for "
                        "decision_page.py --truth")
    options = parser.parse_args()
    names = [c.name for c in read_classes(options.classes)[1]]
    if options.table:
        lines = [f"{row['frame']},{row['camera']},{row['input_id']},{row['part']},{int(moves)}"
                 for row, moves, _ in judged_segments(options.priors[0], names, options.min_area)]
        Path(options.table).write_text("\n".join(["frame,camera,input_id,part,moving", *lines, ""]),
                                       encoding="utf-8")
    for folder in options.priors:
        result = count(judged_segments(folder, names, options.min_area), options.max_depth)
        print(f"{folder}: true {result['true']}, missed {result['missed']}, false {result['false']} "
              f"({result['part']} of them a part of the car), true static "
              f"{result['true static']} (not judged {result['not judged']}); the car "
              f"within {options.max_depth:g} m: {result['near true']} of {result['near']}")
        for kind, row in result["wrong"] if options.list else []:
            says = ", ".join(f"{key[9:]} {row[key]}" for key in row if key.startswith("evidence_"))
            print(f"  {kind:6} {row['frame']} {row['camera']:5} {names[row['label']]} "
                  f"{row['area_px']} px at {row['mean_depth_m']:.0f} m; {says or 'residual ' + row['residual_px']}")


if __name__ == "__main__":
    inputs.run(main)
