#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Fits the numbers of perception_levels.inc to what build_priors does on rendered worlds.

    fit_perception.py WORLD:EXACT:ESTIMATED [...] > perception_levels.inc

WORLD is a folder of simulate_sequence, EXACT prior files made of its own ground truth, ESTIMATED of
--disparity sgbm --flow-left dis --flow-right dis with its panoptic images. The fit reads
ground_truth.csv of the world and segments.csv of the two folders. The true motion of a segment in
the image is the residual that exact flow gives. Pixels are those of the worlds' width. Needs NumPy.
"""
import os
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "common"))
import inputs  # noqa: E402

LEAST_AREA = 48  # px^2, as in perception.cpp


TRUTH = {"frame": int, "camera": str, "segment_id": str, "object": str, "isthing": str, "moving": str}
SEGMENTS = {"frame": int, "camera": str, "input_id": str, **dict.fromkeys(
    ("area_px", "mean_depth_m", "residual_px", "magnitude_test", "radial_test", "rho"), float)}


def rows_of(world, exact, estimated):
    """One dict per thing segment that both folders have, the last frame left out."""
    truth = {(r["frame"], r["camera"], r["segment_id"]): r
             for r in inputs.read_table(os.path.join(world, "ground_truth.csv"), TRUTH)}
    tables = []
    for folder in (exact, estimated):
        tables.append({(r["frame"], r["camera"], r["input_id"]): r
                       for r in inputs.read_table(os.path.join(folder, "segments.csv"), SEGMENTS)})
    last = max((key[0] for key in truth), default=0)
    for key, e in tables[1].items():
        t, x = truth.get(key), tables[0].get(key)
        if t is None or x is None or t["isthing"] != "1" or key[0] == last:
            continue
        if x["area_px"] < LEAST_AREA:
            continue
        yield {"key": (world, key[1], t["object"], key[0]), "moving": t["moving"] == "1",
               "area": x["area_px"], "exact": x, "estimated": e}


def width_of(world):
    folder = os.path.join(world, "image_0")
    if not os.listdir(folder):
        inputs.fail(f"{folder}: has no images")
    with open(os.path.join(folder, sorted(os.listdir(folder))[0]), "rb") as file:
        return int.from_bytes(file.read(24)[16:20], "big")


def logistic(columns, flags):
    """Coefficients of a logistic regression, with a weak pull towards zero."""
    design = np.column_stack([np.ones(len(flags)), *columns])
    ridge = np.diag([1e-3] + [1.0] * len(columns))
    w = np.zeros(design.shape[1])
    for _ in range(100):
        p = 1 / (1 + np.exp(-np.clip(design @ w, -30, 30)))
        gradient = design.T @ (flags - p) - ridge @ w
        step = np.linalg.solve(design.T @ (design * (p * (1 - p))[:, None]) + ridge, gradient)
        w += np.clip(step, -2, 2)
    return w, 1 / (1 + np.exp(-design @ w))


def persistence(keys, flags, expected):
    """Correlation, from frame to frame of one object, of what decides (a normal deviate)."""
    at = {key: i for i, key in enumerate(keys)}
    z = (flags - expected) / np.sqrt(np.maximum(expected * (1 - expected), 1e-3))
    pairs = [(i, at[(*key[:3], key[3] + 1)]) for key, i in at.items()
             if (*key[:3], key[3] + 1) in at]
    a, b = z[[i for i, _ in pairs]], z[[j for _, j in pairs]]
    c = float(np.mean(a * b) / np.mean(z * z)) if len(pairs) > 20 else 0.0
    return float(np.clip(np.sin(np.pi / 2 * c), 0, 0.98))


def spread(x):
    """Median and robust standard deviation."""
    m = np.median(x)
    return float(m), float(1.4826 * np.median(np.abs(x - m)))


def fit(rows, name):
    side = "exact" if name == "exact" else "estimated"
    get = lambda column: np.array([r[side][column] for r in rows])
    area = np.log(np.array([r["area"] for r in rows]) / 1000)
    motion = np.maximum(np.array([r["exact"]["residual_px"] for r in rows]), 1e-2)
    moving = np.array([r["moving"] for r in rows])
    flags = ((get("magnitude_test") + get("radial_test")) > 0).astype(float)
    rho = np.maximum(get("rho"), 1e-3)
    m, p_moving = logistic([np.log(motion[moving]), area[moving]], flags[moving])
    s, p_still = logistic([area[~moving]], flags[~moving])
    expected = np.empty(len(rows))
    expected[moving], expected[~moving] = p_moving, p_still
    level = {"moving0": m[0], "moving1": m[1], "moving2": m[2], "still0": s[0], "still1": s[1],
             "persistence": persistence([r["key"] for r in rows], flags, expected)}
    # r / rho is the reference, as far as a flagged segment's motion is measured right. Beyond 100
    # rho is cut.
    good = moving & (flags > 0) & (rho < 99)
    by_frame = {}
    ratio = np.log(motion / rho)
    for i in np.flatnonzero(good):
        by_frame.setdefault((rows[i]["key"][0], rows[i]["key"][3]), []).append(ratio[i])
    frames = np.array([np.median(v) for v in by_frame.values()])
    level["reference"] = np.exp(np.median(ratio[good]))
    level["reference_sd"] = spread(frames)[1]
    level["motion_sd"] = np.sqrt(max(0.0, spread(ratio[good])[1] ** 2 - level["reference_sd"] ** 2))
    false = ~moving & (flags > 0)
    if false.sum() > 5:
        median, level["false_rho_sd"] = spread(np.log(rho[false]))
        level["false_rho"] = np.exp(median)
    scale = [np.log(r["estimated"]["area_px"] * r["estimated"]["mean_depth_m"] ** 2) -
             np.log(r["exact"]["area_px"] * r["exact"]["mean_depth_m"] ** 2)
             for r in rows if r["estimated"]["mean_depth_m"] > 0 and r["exact"]["mean_depth_m"] > 0]
    if name != "exact":
        level["scale_sd"] = spread(np.array(scale))[1]
    counts = (int(flags[moving].sum()), int(moving.sum()), int(flags[~moving].sum()),
              int((~moving).sum()))
    return level, counts


def main():
    sources = [argument.split(":") for argument in sys.argv[1:]]
    if not sources or any(len(s) != 3 for s in sources):
        print(__doc__, file=sys.stderr)
        return 2
    widths = {width_of(s[0]) for s in sources}
    if len(widths) != 1:
        inputs.fail("worlds of different widths")
    rows = [row for source in sources for row in rows_of(*source)]
    if len({row["moving"] for row in rows}) < 2:
        inputs.fail("needs segments that move and segments that do not")
    worlds = ", ".join(os.path.basename(os.path.normpath(s[0])) for s in sources)
    print("// SPDX-License-Identifier: BSD-3-Clause")
    print(f"// Written by fit_perception.py from {len(rows)} segments of {worlds}.")
    for name in ("exact", "estimated"):
        level, counts = fit(rows, name)
        print("// %s: flagged %d of %d that move, %d of %d that do not." % (name, *counts))
        print("{\n    .name = \"%s\"," % name)
        print("    .width = %d," % min(widths))
        for key, value in level.items():
            print("    .%s = %.3f," % (key, value))
        print("},")
    return 0


if __name__ == "__main__":
    inputs.run(main)
