# SPDX-License-Identifier: BSD-3-Clause
"""What the adapters share: lists of images, atomic files, progress, resuming."""

import argparse
import hashlib
import importlib
import json
import os
import re
import struct
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "common"))
from inputs import (BAD_CONTENT, InputError, fail, first_line, read_table, reading,  # noqa: E402, F401
                    run, whole)

IMAGE_ENDINGS = {".png", ".jpg", ".jpeg"}
PAIRS = {"grey": ("image_0", "image_1"), "colour": ("image_2", "image_3")}


def image_pair(sequence, wanted=""):
    """Left and right image folder that run_stereo_kitti tracks (--pair). The right one may be
    missing. InputError when there is no left one."""
    for name, (left, right) in PAIRS.items():
        if wanted in ("", name) and (Path(sequence) / left).is_dir():
            return Path(sequence) / left, Path(sequence) / right
    fail(f"{sequence}: has no {wanted + ' ' if wanted else ''}images (image_0, image_2)")


def frame_order(file):
    """Key of the programs' order of frames: names by text, whole numbers in them by value, digits
    after a decimal point by text."""
    key = []
    for part in re.findall(r"(?<=[0-9])\.[0-9]*|[0-9]+|[^0-9]", Path(file).stem, re.DOTALL):
        digits = part.lstrip("0")
        key += [("0", len(digits), digits)] if "0" <= part[0] <= "9" else [(c,) for c in part]
    return key


def list_images(folder):
    """Images of a folder in the order of frames. InputError when there are none."""
    folder = Path(folder)
    if not folder.is_dir():
        fail(f"{folder}: is not a folder")
    files = sorted((f for f in folder.iterdir() if f.suffix.lower() in IMAGE_ENDINGS),
                   key=lambda f: (frame_order(f), f))
    if not files:
        fail(f"{folder}: has no images")
    return files


def partners(left, right):
    """[(left image, right image of the same name)] of two lists. InputError for one without."""
    right_by_name = {path.stem: path for path in right}
    for path in left:
        if path.stem not in right_by_name:
            fail(f"{path}: has no partner in the right folder")
    return [(path, right_by_name[path.stem]) for path in left]


def note_images(output, folder):
    """Says in OUTPUT/images.txt of which images it was made: build_priors refuses perception of
    another camera pair than the tracked one."""
    Path(output).mkdir(parents=True, exist_ok=True)
    write_atomic(Path(output) / "images.txt", (Path(folder).resolve().name + "\n").encode())


def digest_of(*parts):
    """SHA-256 of texts and of the contents of files (Path)."""
    value = hashlib.sha256()
    for part in parts:
        with reading(part):
            data = part.read_bytes() if isinstance(part, Path) else part.encode()
        value.update(len(data).to_bytes(8, "little") + data)
    return value.hexdigest()


def digest_of_network(model):
    """SHA-256 of the class and the weights of a torch network."""
    value = hashlib.sha256(type(model).__name__.encode())
    for name, weights in model.state_dict().items():
        value.update(name.encode() + weights.detach().cpu().float().numpy().tobytes())
    return value.hexdigest()


def _note_of(output):
    return output.parent / ".notes" / f"{output.name}.json"


def read_note(output, made_of):
    """What write_note() noted of an output. None when the output is of something else than `made_of`,
    incomplete or not there: it is to be made again."""
    try:
        note = json.loads(_note_of(output).read_text(encoding="utf-8"))
        current = note["made_of"] == made_of and note["output"] == digest_of(output)
    except (OSError, *BAD_CONTENT):
        return None
    return note if current else None


def write_note(output, made_of, **more):
    """Notes beside an output what it was made of: a digest of the images, the network and the settings."""
    note = {"made_of": made_of, "output": digest_of(output), **more}
    _note_of(output).parent.mkdir(parents=True, exist_ok=True)
    write_atomic(_note_of(output), json.dumps(note).encode("ascii"))
    return note


def read_rgb(path):
    """(H, W, 3) uint8; grey images are repeated."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            return np.array(image.convert("RGB"))
    except Exception as error:  # Pillow has no common base class of its errors
        fail(f"{path}: cannot read: {first_line(error)}")


def write_atomic(path, data):
    """Writes bytes to a temporary file beside `path` and renames it."""
    path = Path(path)
    temporary = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(data)
        os.replace(temporary, path)
    except OSError as error:
        fail(f"cannot write {path}: {error.strerror}")
    finally:
        try:
            temporary.unlink(missing_ok=True)
        except OSError:
            pass  # its folder is none


def write_flo(path, flow):
    """Middlebury .flo of an (H, W, 2) array, px."""
    height, width = flow.shape[:2]
    header = struct.pack("<fii", 202021.25, width, height)
    write_atomic(path, header + np.ascontiguousarray(flow, "<f4").tobytes())


def write_pfm(path, disparity):
    """Grey PFM of an (H, W) array, rows from bottom to top, little-endian."""
    height, width = disparity.shape
    header = f"Pf\n{width} {height}\n-1.0\n".encode("ascii")
    write_atomic(path, header + np.ascontiguousarray(disparity[::-1], "<f4").tobytes())


def progress(items, label):
    """tqdm when it is installed, plain lines otherwise."""
    try:
        from tqdm import tqdm

        return tqdm(items, desc=label, unit="frame")
    except ImportError:
        return _lines(items, label)


def _lines(items, label):
    step = max(1, len(items) // 20)
    for i, item in enumerate(items):
        if i % step == 0:
            print(f"{label} {i}/{len(items)}", file=sys.stderr, flush=True)
        yield item


def need(*modules):
    """InputError when a network library is not installed."""
    for module in modules:
        try:
            importlib.import_module(module)
        except ImportError as error:
            fail(f"{error}; tools/setup.sh --perception installs what the adapters need")


def choose_device(name):
    """torch device by name; "auto" is CUDA where there is one."""
    import torch

    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        fail(f"--device {name}: {first_line(error)}")
    return device


def arguments(description, inputs):
    """Parser with what every adapter has. `inputs`: (name, help) of the positional folders."""
    parser = argparse.ArgumentParser(description=description)
    for name, text in inputs:
        parser.add_argument(name, help=text)
    parser.add_argument("--output", required=True, help="folder to write to")
    parser.add_argument("--device", default="auto", help="auto, cpu, cuda, cuda:1, mps")
    parser.add_argument("--overwrite", action="store_true", help="replace existing outputs")
    return parser
