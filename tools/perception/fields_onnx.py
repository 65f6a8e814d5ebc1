# SPDX-License-Identifier: BSD-3-Clause
"""Optical flow (.flo) or disparity (.pfm) with any network as ONNX file, by ONNX Runtime.

    fields_onnx.py SEQUENCE/image_0 --model FLOW.yaml --output flow/left [--backward flow_back/left]
    fields_onnx.py SEQUENCE/image_0 SEQUENCE/image_1 --model STEREO.yaml --output disparity/left \\
        [--right disparity/right]

The YAML file says what the network takes and gives (README.md). Flow is from each frame to the next,
under the first one's name; the last frame has none. --backward also writes the flow from the next frame
back, under the same name. Disparity is of the left image. --right also writes that of the right image:
the network runs on both images, swapped and flipped. Images must be rectified and have the same names in
both folders.
"""

import argparse
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import common  # noqa: E402
from onnx_network import OnnxNetwork, add_jobs, in_threads, read_image  # noqa: E402

FIELDS_VERSION = 1  # raised when the same images give other fields
TOO_LARGE = 1e5     # px; such values are unknown, in build_priors too
PLANES = {"flow": 2, "disparity": 1}
SHAPES = {"flow": "(1, 2, h, w) or (1, h, w, 2)",
          "disparity": "(1, 1, h, w), (1, h, w, 1), (1, h, w) or (h, w)"}
KEYS = {"": ("file", "kind", "input", "output"),
        "input": ("size", "colour", "gamma", "divide_by", "mean", "deviation", "names"),
        "output": ("name", "unit", "sign")}
COLOURS, UNITS, SIGNS = ("rgb", "bgr", "grey"), ("input", "output"), (1, -1)


class FieldNetwork(OnnxNetwork):
    """An ONNX network for flow or disparity and what its YAML file says about it. InputError when it is
    of another kind than `wanted`, or takes or gives tensors of other shapes than the file says."""

    def __init__(self, settings, weights=None, wanted=None):
        super().__init__(settings, weights)
        if wanted not in (None, self.kind):
            common.fail(f"{self.path}: kind is '{self.kind}', not {wanted}")
        self.names = self._input_names()
        self._check_inputs()
        self.output = self._check_output("name", self.output or self.outputs[-1])
        shape = self.session.get_outputs()[self.outputs.index(self.output)].shape
        if shape and all(isinstance(side, int) for side in shape):
            self._check_shape(shape)

    def _read_settings(self):
        for section, keys in KEYS.items():
            self._check_keys(section, keys)
        self.kind = self._one_of("kind", self._get("kind"), tuple(SHAPES))
        self._get("input", "size")
        entry, output = self.settings["input"], self.settings.get("output", {})
        colour = self._one_of("input.colour", entry.get("colour", "rgb"), COLOURS)
        self._read_input(1 if colour == "grey" else 3)
        self.unit = self._one_of("output.unit", output.get("unit", "input"), UNITS)
        self.sign = self._one_of("output.sign", output.get("sign", 1), SIGNS)
        self.output = str(output["name"]) if "name" in output else None

    def _check_keys(self, section, keys):
        entry = self.settings.get(section, {}) if section else self.settings
        if not isinstance(entry, dict):
            common.fail(f"{self.path}: {section} is '{entry}', not a list of settings")
        for key in entry:
            if key not in keys:
                common.fail(f"{self.path}: {section + '.' if section else ''}{key} is not one of "
                            f"{', '.join(keys)}")

    def _one_of(self, name, value, values):
        if value not in values:
            common.fail(f"{self.path}: {name} is '{value}', not one of {', '.join(map(str, values))}")
        return value

    def _input_names(self):
        """Inputs for the first and the second image, or one for both."""
        if len(self.inputs) > 2:
            common.fail(f"{self.file}: has {len(self.inputs)} inputs ({', '.join(self.inputs)}), not "
                        "one or two")
        given = self.settings["input"].get("names", self.inputs)
        names = [str(name) for name in given] if isinstance(given, list) else [str(given)]
        if sorted(names) != sorted(self.inputs):
            common.fail(f"{self.path}: input.names is '{', '.join(names)}', the network has "
                        f"{', '.join(self.inputs)}")
        return names

    def _check_inputs(self):
        """Sizes that the network states. A size that it leaves open is a text, and fits."""
        wanted = (1, self.channels * (3 - len(self.names)), self.height, self.width)
        for entry in self.session.get_inputs():
            shape = entry.shape
            if shape and (len(shape) != 4 or
                          any(isinstance(side, int) and side != v for side, v in zip(shape, wanted))):
                common.fail(f"{self.file}: input '{entry.name}' is {as_text(shape)}, not "
                            f"{as_text(wanted)} (input.size, colour and names of {self.path})")

    def _check_shape(self, shape):
        """One of SHAPES, and not empty; as it is with four dimensions."""
        least = 4 if self.kind == "flow" else 2
        full = (*[1] * (4 - len(shape)), *shape)
        fits = least <= len(shape) <= 4 and full[0] == 1 and PLANES[self.kind] in (full[1], full[3])
        if not fits or 0 in shape:
            common.fail(f"{self.path}: output '{self.output}' is {as_text(shape)}, not "
                        f"{SHAPES[self.kind]} as {self.kind} is")
        return full

    def run(self, first, second):
        """(h, w, 2) flow or (h, w, 1) disparity as the network gives it, for (H, W, 3) RGB images."""
        images = [self.prepare(image) for image in (first, second)]
        if len(self.names) == 1:
            images = [np.concatenate(images, axis=1)]
        found = self._outputs_of(dict(zip(self.names, images)), [self.output])[self.output]
        with common.reading(f"{self.path}: output '{self.output}'"):
            found = np.asarray(found, np.float32)
        found = found.reshape(self._check_shape(found.shape))[0]
        return found.transpose(1, 2, 0) if found.shape[0] == PLANES[self.kind] else found

    def field(self, first, second):
        """Flow (H, W, 2) from the first to the second image, or disparity (H, W, 1) of the first one,
        the left one, both (H, W, 3) RGB. In px of the images, NaN unknown."""
        import cv2

        raw = self.sign * self.run(first, second)
        good = np.abs(raw) < TOO_LARGE
        if self.kind == "disparity":
            good &= raw > 0
        # Unknown values do not mix with others when the field is enlarged.
        raw[~good.all(axis=2)] = np.nan
        height, width = first.shape[:2]
        of_width, of_height = ((raw.shape[1], raw.shape[0]) if self.unit == "output" else
                               (self.width, self.height))
        scale = np.array([width / of_width, height / of_height][:raw.shape[2]], np.float32)
        big = cv2.resize(np.ascontiguousarray(raw), (width, height), interpolation=cv2.INTER_LINEAR)
        return big.reshape(height, width, -1) * scale


class Field(NamedTuple):
    """A file to write, and the images that it is of."""

    target: Path
    first: Path
    second: Path
    flipped: bool = False  # right disparity: as left disparity of the flipped images


def as_text(shape):
    return f"({', '.join(map(str, shape))})"


def read_pair(item):
    images = [read_image(path) for path in (item.first, item.second)]
    sizes = [f"{image.shape[1]}x{image.shape[0]}" for image in images]
    if sizes[0] != sizes[1]:
        common.fail(f"{item.second}: is {sizes[1]}, {item.first} is {sizes[0]}")
    return [image[:, ::-1] for image in images] if item.flipped else images


def write_field(item, field):
    if item.flipped:
        field = field[:, ::-1]
    if field.shape[2] == 2:
        common.write_flo(item.target, field)
    else:
        common.write_pfm(item.target, np.nan_to_num(field[:, :, 0], nan=0))


def make_field(network, item, overwrite):
    """The note of a field, and whether the field is new. What is there of the same images, network and
    settings is kept."""
    made_of = common.digest_of(network.description(version=FIELDS_VERSION, flipped=item.flipped),
                               item.first, item.second)
    note = None if overwrite else common.read_note(item.target, made_of)
    if note is not None:
        return note, False
    images = read_pair(item)
    start = time.perf_counter()
    field = network.field(*images)
    seconds = time.perf_counter() - start
    write_field(item, field)
    known = float(np.isfinite(field).mean())
    return common.write_note(item.target, made_of, seconds=seconds, known=known), True


def make_fields(network, work, overwrite, label, jobs):
    """Writes the fields in the list `work`, `jobs` at a time. Returns their number, the number of those
    made now, and seconds in the network for all, summed; those of kept fields are as measured."""
    done = in_threads(lambda item: make_field(network, item, overwrite), work, label, jobs)
    if done and not any(note["known"] for note, _ in done):
        what = "no finite flow" if network.kind == "flow" else "no positive disparity (output.sign)"
        common.fail(f"{network.path}: the network gives {what} in any image")
    return {"fields": len(done), "made": sum(new for _, new in done),
            "seconds": sum(note["seconds"] for note, _ in done)}


def make_flow(network, images, output, backward=None, overwrite=False, label="flow", jobs=1):
    """OUTPUT/<name>.flo from every image to the next one, BACKWARD/<name>.flo from the next one back.
    Returns what make_fields() does."""
    work = []
    for folder in filter(None, (output, backward)):
        common.note_images(folder, images[0].parent)
    for now, following in zip(images[:-1], images[1:]):
        work.append(Field(Path(output) / f"{now.stem}.flo", now, following))
        if backward:
            work.append(Field(Path(backward) / f"{now.stem}.flo", following, now))
    return make_fields(network, work, overwrite, label, jobs)


def make_disparity(network, pairs, output, output_right=None, overwrite=False, jobs=1):
    """OUTPUT/<name>.pfm of the left image of every pair, OUTPUT_RIGHT/<name>.pfm of the right one.
    Returns what make_fields() does."""
    work = []
    for folder, image in zip(filter(None, (output, output_right)), pairs[0]):
        common.note_images(folder, image.parent)
    for left, right in pairs:
        work.append(Field(Path(output) / f"{left.stem}.pfm", left, right))
        if output_right:
            work.append(Field(Path(output_right) / f"{left.stem}.pfm", right, left, flipped=True))
    return make_fields(network, work, overwrite, "disparity", jobs)


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("images", help="folder of images; disparity: of left images")
    parser.add_argument("right_images", nargs="?", help="disparity: folder of right images")
    parser.add_argument("--model", required=True, help="YAML file of the network")
    parser.add_argument("--weights", help="ONNX file (default: what the YAML file names)")
    parser.add_argument("--output", required=True, help="folder to write to")
    parser.add_argument("--backward", help="flow: folder for the backward flow, from the next frame")
    parser.add_argument("--right", help="disparity: folder for the disparity of the right images")
    parser.add_argument("--overwrite", action="store_true", help="replace existing outputs")
    add_jobs(parser)
    return parser.parse_args()


def main():
    options = parse_arguments()
    common.need("onnxruntime", "yaml", "cv2")
    network = FieldNetwork(options.model, options.weights)
    stereo = network.kind == "disparity"
    if stereo != bool(options.right_images):
        common.fail(f"{options.model}: kind is '{network.kind}', which takes "
                    f"{'two folders' if stereo else 'one folder'} of images")
    if options.backward if stereo else options.right:
        common.fail(f"{'--backward' if stereo else '--right'} does not apply to kind '{network.kind}'")
    images = common.list_images(options.images)
    how = {"overwrite": options.overwrite, "jobs": options.jobs}
    if stereo:
        pairs = common.partners(images, common.list_images(options.right_images))
        made = make_disparity(network, pairs, options.output, options.right, **how)
    else:
        made = make_flow(network, images, options.output, options.backward, **how)
    print(f"{made['made']} fields, {made['fields'] - made['made']} kept, network "
          f"{1e3 * made['seconds'] / max(1, made['fields']):.0f} ms per field")


if __name__ == "__main__":
    common.run(main)
