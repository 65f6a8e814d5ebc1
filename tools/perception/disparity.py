# SPDX-License-Identifier: BSD-3-Clause
"""Disparity of rectified pairs, through RAFT flow from one image to the other, as PFM.

    disparity.py SEQUENCE/image_2 SEQUENCE/image_3 --output disparity [--right disparity_right]

In a rectified pair the flow from left to right is (-disparity, 0). Pixels whose vertical flow says
otherwise (over 2 px) get 0, which means unknown. Images must have the same names in both folders.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import common  # noqa: E402
import flow as flow_module  # noqa: E402


def to_disparity(flow, sign, largest_vertical=2.0):
    """Positive disparity (H, W) in px, 0 unknown. sign -1: flow left to right; +1: right to left."""
    disparity = sign * flow[..., 0]
    bad = (np.abs(flow[..., 1]) > largest_vertical) | ~(disparity > 0)
    return np.where(bad, 0, disparity).astype(np.float32)


def process(left, right, output, output_right, model, device, iterations=20, overwrite=False):
    """Disparity of all pairs; what is there of the same images, network and settings is kept."""
    folders = [Path(output)] + ([Path(output_right)] if output_right else [])
    for folder, image in zip(folders, (left[0], right[0])):
        common.note_images(folder, image.parent)
    network = common.digest_of_network(model)
    for file, partner in common.progress(common.partners(left, right), "disparity"):
        targets = [folder / f"{file.stem}.pfm" for folder in folders]
        made_of = common.digest_of(f"disparity, {network}, {iterations} iterations", file, partner)
        if not overwrite and all(common.read_note(t, made_of) for t in targets):
            continue
        pair = [common.read_rgb(file), common.read_rgb(partner)]
        if pair[0].shape != pair[1].shape:
            common.fail(f"{partner}: has another size than the left image")
        forward = flow_module.estimate(model, *pair, device, iterations)
        common.write_pfm(targets[0], to_disparity(forward, -1))
        if output_right:
            back = flow_module.estimate(model, *pair[::-1], device, iterations)
            common.write_pfm(targets[1], to_disparity(back, +1))
        for target in targets:
            common.write_note(target, made_of)


def main():
    parser = common.arguments(__doc__.splitlines()[0],
                              [("left", "folder of left images"), ("right", "of right images")])
    parser.add_argument("--right", dest="output_right", help="folder for the right disparity")
    parser.add_argument("--model", choices=["raft_large", "raft_small"], default="raft_large")
    parser.add_argument("--weights", default="default", help="default (downloads) or a file")
    parser.add_argument("--iterations", type=int, default=20)
    options = parser.parse_args()
    left, right = common.list_images(options.left), common.list_images(options.right)
    common.need("torch", "torchvision", "PIL")
    device = common.choose_device(options.device)
    model = flow_module.load_raft(options.model, options.weights, device)
    process(left, right, options.output, options.output_right, model, device, options.iterations,
            options.overwrite)


if __name__ == "__main__":
    common.run(main)
