# SPDX-License-Identifier: BSD-3-Clause
"""Identities of thing segments over time against exact ones: IDF1 and switches.

    score_identities.py PRIORS ground_truth.csv [--camera left] [--min-area 200]

PRIORS is a folder made by build_priors from exact segments, the truth simulate_sequence's table. The
segments being exact, IDF1 (Ristani et al., 2016) is the share of them whose identity is the one that
the best one-to-one assignment over the whole sequence gives their object. A switch is an object that
has another identity than when it was last seen. Needs SciPy.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "common"))
import inputs  # noqa: E402


SEGMENTS = {"frame": int, "camera": str, "input_id": str, "identity": str, "area_px": int}
TRUTH = {"frame": int, "camera": str, "segment_id": str, "object": str, "isthing": str}


def pairs_of(rows, truth, camera, min_area):
    """(object, identity) of every segment, in order of frames."""
    objects = {(r["frame"], r["camera"], r["segment_id"]): r["object"]
               for r in truth if r["isthing"] == "1"}
    rows = sorted((r for r in rows if r["camera"] == camera and r["area_px"] >= min_area),
                  key=lambda r: r["frame"])
    keys = [(r["frame"], camera, r["input_id"]) for r in rows]
    return [(objects[key], row["identity"]) for key, row in zip(keys, rows) if key in objects]


def score(pairs):
    """(IDF1, switches, objects, identities)."""
    objects = {name: i for i, name in enumerate(sorted({p[0] for p in pairs}))}
    identities = {name: i for i, name in enumerate(sorted({p[1] for p in pairs}))}
    together = np.zeros((len(objects), len(identities)))
    switches, last = 0, {}
    for name, identity in pairs:
        together[objects[name], identities[identity]] += 1
        switches += last.get(name, identity) != identity
        last[name] = identity
    rows, columns = linear_sum_assignment(-together)
    share = together[rows, columns].sum() / len(pairs) if pairs else 0.0
    return share, switches, len(objects), len(identities)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("priors")
    parser.add_argument("truth")
    parser.add_argument("--camera", choices=("left", "right"), default="left")
    parser.add_argument("--min-area", type=inputs.whole(0), default=200, help="px")
    options = parser.parse_args()
    pairs = pairs_of(inputs.read_table(Path(options.priors) / "segments.csv", SEGMENTS),
                     inputs.read_table(options.truth, TRUTH), options.camera, options.min_area)
    share, switches, objects, identities = score(pairs)
    print(f"IDF1 {share:.3f}, {switches} switches, {objects} objects, {identities} identities")


if __name__ == "__main__":
    inputs.run(main)
