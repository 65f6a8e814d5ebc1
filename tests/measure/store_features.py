#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Features of a network, of all images of a sequence, for evaluate_places --stored-features.

    tests/measure/store_features.py SEQUENCE --features MODEL.yaml --output FILE [--count N]
"""

import argparse
import json
import sys
from itertools import islice

import numpy as np

import kys_slam
from kys_slam import InputError
from kys_slam.feature_network import FeatureNetwork
from kys_slam.segment_network import NetworkError


def header(features):
    """What the program must know of the extractor: one line."""
    names = ("name", "scale_factor", "levels", "sizes", "reach", "oriented", "pixel_sigma")
    distances = features.distances or {"matching": [], "other": []}
    return json.dumps({**{name: getattr(features, name) for name in names}, **distances}) + "\n"


def image_bytes(image, found):
    """Key and features of an image; the key as in stored_features.cpp."""
    pixels = np.ascontiguousarray(image).ravel().astype(np.uint64)
    key = [pixels.sum(), (pixels * np.arange(1, len(pixels) + 1, dtype=np.uint64)).sum()]
    table = np.zeros(len(found["positions"]), [("position", "<f4", 2), ("angle", "<f4"), ("score", "<f4"),
                                               ("octave", "u1"), ("descriptor", "u1", 32)])
    table["position"], table["descriptor"] = found["positions"], found["descriptors"]
    table["angle"], table["score"], table["octave"] = (found[k] for k in ("angles", "scores", "octaves"))
    return np.array(key, "<u8").tobytes() + np.array(len(table), "<u4").tobytes() + table.tobytes()


def store(features, recording, file, frames=None):
    file.write(header(features).encode())
    for frame in islice(recording, frames):
        for image in (np.asarray(frame.left), np.asarray(frame.right)):
            file.write(image_bytes(image, features(image)))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("sequence")
    parser.add_argument("--features", required=True, metavar="MODEL.yaml")
    parser.add_argument("--features-weights", metavar="FILE.onnx")
    parser.add_argument("--count", type=int, help="features per image (default: of MODEL.yaml)")
    parser.add_argument("--frames", type=int)
    parser.add_argument("--output", required=True)
    args = parser.parse_args()
    try:
        features = FeatureNetwork(args.features, args.features_weights).features(args.count)
        with open(args.output, "wb") as file:
            store(features, kys_slam.open_sequence(args.sequence), file, args.frames)
    except (InputError, NetworkError, OSError) as error:
        print(f"store_features: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
