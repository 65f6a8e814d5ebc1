"""Precision and recall of "moving" per thing segment.

    score_detection.py priors/segments.csv truth.csv [--min-area 200]

truth.csv has columns frame,camera,input_id,moving (0/1) and, if known, shift_m and depth_m: with
them the segments that move more than --min-shift within --max-depth are reported as well.
"""

import argparse
import csv


def read(path):
    with open(path, newline="", encoding="utf-8") as stream:
        return {(r["frame"], r["camera"], r["input_id"]): r for r in csv.DictReader(stream)}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("segments")
    parser.add_argument("truth")
    parser.add_argument("--min-area", type=int, default=200, help="px")
    parser.add_argument("--min-shift", type=float, default=0.3, help="m between frames")
    parser.add_argument("--max-depth", type=float, default=30.0, help="m")
    options = parser.parse_args()
    truth = read(options.truth)
    counts = {"true": 0, "false": 0, "missed": 0}
    clear, clear_found, unknown = 0, 0, 0
    by_test = {"magnitude_test": [0, 0], "radial_test": [0, 0]}
    for key, row in read(options.segments).items():
        if int(row["area_px"]) < options.min_area:
            continue
        if key not in truth:
            unknown += 1
            continue
        moving = truth[key]["moving"] == "1"
        found = row["magnitude_test"] == "1" or row["radial_test"] == "1"
        if found:
            counts["true" if moving else "false"] += 1
        elif moving:
            counts["missed"] += 1
        for test, hits in by_test.items():
            if row[test] == "1":
                hits[0 if moving else 1] += 1
        shift, depth = truth[key].get("shift_m"), truth[key].get("depth_m")
        if shift and depth and float(shift) > options.min_shift and float(
                depth) < options.max_depth:
            clear += 1
            clear_found += found
    flagged = counts["true"] + counts["false"]
    moving = counts["true"] + counts["missed"]
    print(f"precision {counts['true'] / flagged if flagged else 1:.3f} ({flagged} flagged)")
    print(f"recall    {counts['true'] / moving if moving else 1:.3f} ({moving} moving)")
    for test, (right, wrong) in by_test.items():
        print(f"{test}: {right} right, {wrong} wrong")
    if clear:
        print(f"recall over {options.min_shift} m within {options.max_depth} m: "
              f"{clear_found / clear:.3f} ({clear})")
    if unknown:
        print(f"{unknown} segments are not in {options.truth}")


if __name__ == "__main__":
    main()
