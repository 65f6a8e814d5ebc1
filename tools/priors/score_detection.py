# SPDX-License-Identifier: BSD-3-Clause
"""Precision and recall of "moving" per thing segment, and the exported motion it leads to.

    score_detection.py PRIORS ground_truth.csv [--motion motion.csv] [--min-area 200] [--mu-step 8] [--list]

PRIORS is a folder made by build_priors. The truth has columns frame,camera,moving (0/1) and
segment_id or input_id: simulate_sequence's ground_truth.csv as it is. --motion is the table of
segment_motion (frame,camera,input_id,shift_m,depth_m): with it the segments that move more than
--min-shift within --max-depth are reported as well. --list prints every wrong decision.
The last frame (of the .kysp files) has no flow and is left out. Precision counts every flagged segment of
--min-area.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "python" / "kys_slam"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "common"))
import inputs  # noqa: E402
import kysp  # noqa: E402


def frame_number(text):
    """Frames are called 12, 000012 or rgb_00012."""
    return int(text[len(text.rstrip("0123456789")):])


SEGMENTS = {"area_px": int, "magnitude_test": str, "radial_test": str, "residual_px": str,
            "radial_px": str, "coverage": str, "omega": str}
MOTION = {"shift_m": float, "depth_m": float}


def read(path, columns):
    """(key, row) of every row; the parts of a segment have the same key."""
    rows = inputs.read_table(path, {"frame": frame_number, "camera": str, **columns})
    with inputs.reading(path):
        return [((r["frame"], r["camera"], r.get("input_id") or r["segment_id"]), r) for r in rows]


def last_frame(folder):
    """Number of the last frame that has priors; None where there is none."""
    with inputs.reading(folder):
        return max((frame_number(path.stem) for path in Path(folder).glob("*.kysp")), default=None)


def score(rows, truth, motion, last, options):
    """Counts of decisions; `rows` are those of segments.csv, without those of frame `last`."""
    result = {"true": 0, "false": 0, "missed": 0, "unknown": 0, "clear": 0, "clear_found": 0,
              "magnitude_test": [0, 0], "radial_test": [0, 0], "wrong": []}
    for key, row in rows:
        if row["area_px"] < options.min_area or key[0] == last:
            continue
        if options.camera and key[1] != options.camera:
            continue
        if key not in truth:
            result["unknown"] += 1
            continue
        moving = truth[key]["moving"] == "1"
        tests = [test for test in ("magnitude_test", "radial_test") if row[test] == "1"]
        if tests:
            result["true" if moving else "false"] += 1
        elif moving:
            result["missed"] += 1
        if bool(tests) != moving:
            result["wrong"].append((key, truth[key], motion.get(key), row))
        for test in tests:
            result[test][0 if moving else 1] += 1
        measured = motion.get(key)
        if (moving and measured and measured["shift_m"] > options.min_shift
                and measured["depth_m"] < options.max_depth):
            result["clear"] += 1
            result["clear_found"] += bool(tests)
    return result


def ratio(part, whole):
    return f"{part / whole:.3f}" if whole else "-"


def report(result, options):
    flagged = result["true"] + result["false"]
    moving = result["true"] + result["missed"]
    print(f"precision {ratio(result['true'], flagged)} ({flagged} flagged)")
    print(f"recall    {ratio(result['true'], moving)} ({moving} moving)")
    for test in ("magnitude_test", "radial_test"):
        print(f"{test}: {result[test][0]} right, {result[test][1]} wrong")
    if result["clear"]:
        print(f"recall over {options.min_shift} m within {options.max_depth} m: "
              f"{ratio(result['clear_found'], result['clear'])} ({result['clear']})")
    if result["unknown"]:
        print(f"{result['unknown']} segments are not in {options.truth}")
    if options.list:
        for key, true, measured, row in result["wrong"]:
            shift = f"{measured['shift_m']} m at {measured['depth_m']} m" if measured else "?"
            print(f"{'missed' if true['moving'] == '1' else 'false '} {key[0]:6} {key[1]:5} "
                  f"id {key[2]:8} {true.get('class', '')} area {row['area_px']} moves {shift}; "
                  f"residual {row['residual_px']} radial {row['radial_px']} coverage "
                  f"{row['coverage']} omega {row['omega']} tests {row['magnitude_test']}"
                  f"{row['radial_test']}")


def exported_motion(folder, step):
    """Motion values mu of all pixels of flagged segments (the paper's Fig. S2)."""
    values = []
    for path in sorted(Path(folder).glob("*.kysp"))[::step]:
        with inputs.reading(path):
            cameras = kysp.read(path).cameras
        for camera in cameras:
            dynamic = np.concatenate([[False], (camera.segments["flags"] & kysp.DYNAMIC) != 0])
            if camera.motion is not None:
                values.append(camera.motion[dynamic[camera.segment_map]])
    return np.concatenate(values) if values else np.zeros(0)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("priors")
    parser.add_argument("truth")
    parser.add_argument("--motion")
    parser.add_argument("--min-area", type=inputs.whole(0), default=200, help="px")
    parser.add_argument("--min-shift", type=float, default=0.3, help="m between frames")
    parser.add_argument("--max-depth", type=float, default=30.0, help="m")
    parser.add_argument("--camera", choices=("left", "right"), help="score only this camera")
    parser.add_argument("--mu-step", type=inputs.whole(0), default=0,
                        help="also score the exported motion, of every N-th frame (slow)")
    parser.add_argument("--list", action="store_true", help="every wrong decision")
    options = parser.parse_args()
    rows = read(Path(options.priors) / "segments.csv", SEGMENTS)
    truth = dict(read(options.truth, {"moving": str}))
    motion = dict(read(options.motion, MOTION)) if options.motion else {}
    report(score(rows, truth, motion, last_frame(options.priors), options), options)
    mu = exported_motion(options.priors, options.mu_step) if options.mu_step else np.zeros(0)
    if mu.size:
        print(f"exported mu over {mu.size} px of flagged segments: {np.mean(mu > 8):.3f} above 8, "
              f"{np.mean(mu > 20):.3f} above 20; quartiles "
              + ", ".join(f"{q:.1f}" for q in np.percentile(mu, [25, 50, 75])))


if __name__ == "__main__":
    inputs.run(main)
