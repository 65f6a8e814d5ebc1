# SPDX-License-Identifier: BSD-3-Clause
"""Optical flow with RAFT of torchvision: each frame to the next, as .flo under the first's name.

    flow.py SEQUENCE/image_2 --output flow/left [--backward flow_back/left]

The last frame has no flow. --backward also writes the flow from the next frame back, filed under
the same name, for the consistency check of build_priors.
"""

import pickle
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import common  # noqa: E402


def load_raft(name, weights, device):
    """raft_large or raft_small; `weights` is "default" (downloaded), "none", or a state-dict file."""
    import torch
    from torchvision.models import optical_flow

    builder = getattr(optical_flow, name)
    try:
        model = builder(weights="DEFAULT" if weights == "default" else None)
        if weights not in ("default", "none"):
            model.load_state_dict(torch.load(weights, map_location="cpu", weights_only=True))
    except (OSError, RuntimeError, pickle.UnpicklingError, EOFError) as error:
        common.fail(f"weights {weights} of {name}: cannot load: {common.first_line(error)}")
    return model.to(device).eval()


def to_tensor(image, device):
    """(1, 3, H, W) in [-1, 1]."""
    import torch

    tensor = torch.from_numpy(image).permute(2, 0, 1)[None].float().to(device)
    return tensor / 127.5 - 1


def estimate(model, first, second, device, iterations=20):
    """Flow (H, W, 2) in px from `first` to `second`, both (H, W, 3) uint8.

    RAFT wants sides that are multiples of 8 and at least 128: images are padded by their edges.
    """
    import torch
    import torch.nn.functional as functional

    height, width = first.shape[:2]
    padded = [max(128, (side + 7) // 8 * 8) for side in (height, width)]
    padding = (0, padded[1] - width, 0, padded[0] - height)
    tensors = [functional.pad(to_tensor(i, device), padding, mode="replicate")
               for i in (first, second)]
    with torch.inference_mode():
        flow = model(*tensors, num_flow_updates=iterations)[-1]
    return flow[0, :, :height, :width].permute(1, 2, 0).float().cpu().numpy()


def process(files, output, backward, model, device, iterations=20, overwrite=False):
    """Flow of all neighbours in `files`; what is there of the same images, network and settings is kept."""
    folders = [Path(output)] + ([Path(backward)] if backward else [])
    for folder in folders:
        common.note_images(folder, files[0].parent)
    network = common.digest_of_network(model)
    for now, following in common.progress(list(zip(files[:-1], files[1:])), "flow"):
        targets = [folder / f"{now.stem}.flo" for folder in folders]
        made_of = common.digest_of(f"flow, {network}, {iterations} iterations", now, following)
        if not overwrite and all(common.read_note(t, made_of) for t in targets):
            continue
        images = [common.read_rgb(now), common.read_rgb(following)]
        if images[0].shape != images[1].shape:
            common.fail(f"{following}: has another size than the frame before")
        common.write_flo(targets[0], estimate(model, *images, device, iterations))
        if backward:
            common.write_flo(targets[1], estimate(model, *images[::-1], device, iterations))
        for target in targets:
            common.write_note(target, made_of)


def main():
    parser = common.arguments(__doc__.splitlines()[0], [("images", "folder of images")])
    parser.add_argument("--backward", help="folder for the backward flow, from the next frame")
    parser.add_argument("--model", choices=["raft_large", "raft_small"], default="raft_large")
    parser.add_argument("--weights", default="default", help="default (downloads) or a file")
    parser.add_argument("--iterations", type=int, default=20)
    options = parser.parse_args()
    files = common.list_images(options.images)
    common.need("torch", "torchvision", "PIL")
    device = common.choose_device(options.device)
    model = load_raft(options.model, options.weights, device)
    process(files, options.output, options.backward, model, device, options.iterations,
            options.overwrite)


if __name__ == "__main__":
    common.run(main)
