# SPDX-License-Identifier: BSD-3-Clause
"""Flow and disparity by ONNX Runtime, and the way from images to prior files with them, with tiny
networks whose results are known by hand. Skipped without onnxruntime, onnx, cv2, yaml."""

import csv
import json
import subprocess
import sys
import tempfile
import unittest
import unittest.mock
from pathlib import Path

import numpy as np

import onnx_support  # makes the modules below known
from onnx_support import (BUILDER, MISSING, ROOT, cv2, onnx, write_graph, write_network, write_sequence,
                          yaml)
import fields_onnx
import make_priors
from fields_onnx import common

SIZE = (40, 60)        # height, width of the networks' inputs; images are as large unless a test says so
FIRST = (10, 20, 31)   # red, green, blue
SECOND = (5, 6, 7)
LOOK = [[1, 0, 0], [0, 2, 0]]    # u: red, v: twice green
OTHER = [[0, 0, 10], [0, 0, 0]]  # u: 10 times blue


def write_fields_network(folder, first, second, kind="flow", size=SIZE, separate=True, layout="nchw",
                         smaller=1, larger=1, last=None, bias=0.0, ramp=0, name="fields", **settings):
    """Sums of the channels of both images with these weights (one row for disparity, two for flow), and
    a bias, plus `ramp` times the column; `last`: an operator on the result, which is averaged over
    smaller x smaller px, or repeated larger x larger times. Two inputs, or one (not separate)."""
    weights = np.concatenate([first, second], axis=1).astype(np.float32)
    rows, channels = weights.shape[0], weights.shape[1] // 2
    constants = {"weights": weights[:, :, None, None], "bias": np.full(rows, bias, np.float32),
                 "columns": np.full((1, rows, *size), ramp * np.arange(size[1]), np.float32),
                 "scales": np.array([1, 1, larger, larger], np.float32)}
    node, nodes = onnx.helper.make_node, []
    if separate:
        inputs = {"a": [1, channels, *size], "b": [1, channels, *size]}
        nodes.append(node("Concat", ["a", "b"], ["images"], axis=1))
    else:
        inputs = {"images": [1, 2 * channels, *size]}
    nodes += [node("Conv", ["images", "weights", "bias"], ["sums"]),
              node("Add", ["sums", "columns"], ["ramped"]),
              node(last or "Identity", ["ramped"], ["given"]),
              node("AveragePool", ["given"], ["small"], kernel_shape=[smaller] * 2,
                   strides=[smaller] * 2),
              node("Resize", ["small", "", "scales"], ["large"], mode="nearest",
                   coordinate_transformation_mode="asymmetric", nearest_mode="floor")]
    shape = [1, rows, *(side * larger // smaller for side in size)]
    squeezed = {"nchw": None, "nhwc": None, "chw": [0], "hw": [0, 1]}[layout]
    if layout == "nhwc":
        nodes.append(node("Transpose", ["large"], ["field"], perm=[0, 2, 3, 1]))
        shape = [shape[0], *shape[2:], shape[1]]
    elif squeezed:
        constants["axes"] = np.array(squeezed, np.int64)
        nodes.append(node("Squeeze", ["large", "axes"], ["field"]))
        shape = shape[len(squeezed):]
    else:
        nodes.append(node("Identity", ["large"], ["field"]))
    # The result is the last output.
    write_graph(folder / f"{name}.onnx", nodes, inputs, {"sums": [1, rows, *size], "field": shape},
                [onnx.numpy_helper.from_array(value, key) for key, value in constants.items()])
    return write_settings(folder, kind, name, size, **settings)


def write_settings(folder, kind="flow", name="fields", size=SIZE, input=None, **settings):
    """The YAML file. `input`: entries beside its size and range."""
    document = {"file": f"{name}.onnx", "kind": kind,
                "input": {"size": list(size), "divide_by": 1, **(input or {})}, **settings}
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def plain(colour, size=SIZE):
    return np.full((*size, 3), colour, np.uint8)


def halves(left, right, size=SIZE):
    """An image with these colours left and right."""
    image = plain(left, size)
    image[:, size[1] // 2:] = right
    return image


def write_images(folder, images):
    """RGB images as frames 000000, ... of a folder; the list of files."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{t:06d}.png" for t in range(len(images))]
    for file, image in zip(files, images):
        cv2.imwrite(str(file), np.ascontiguousarray(image[:, :, ::-1]))
    return files


def read_flo(path):
    """(H, W, 2) px"""
    data = path.read_bytes()
    width, height = np.frombuffer(data, "<i4", 2, 4)
    return np.frombuffer(data, "<f4", offset=12).reshape(height, width, 2)


def read_pfm(path):
    """(H, W) px"""
    kind, size, scale, data = path.read_bytes().split(b"\n", 3)
    assert (kind, scale) == (b"Pf", b"-1.0")
    width, height = map(int, size.split())
    return np.frombuffer(data, "<f4").reshape(height, width)[::-1]


class Case(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)

    def network(self, first, second, **arguments):
        return fields_onnx.FieldNetwork(write_fields_network(self.folder, first, second, **arguments))

    def refused(self, text, function, *arguments, **more):
        with self.assertRaises(common.InputError) as caught:
            function(*arguments, **more)
        self.assertIn(text, str(caught.exception))
        self.assertNotIn("\n", str(caught.exception))

    def call(self, *arguments):
        """The finished process of fields_onnx.py."""
        return subprocess.run(
            [sys.executable, str(ROOT / "tools" / "perception" / "fields_onnx.py"), *map(str, arguments),
             "--jobs", "2"], capture_output=True, text=True, check=False)


@unittest.skipIf(MISSING, MISSING)
class Fields(Case):
    """What the network gives, in px of the images."""

    def flow(self, first=FIRST, second=SECOND, size=SIZE, **arguments):
        """The flow (u, v) of plain images, the same everywhere."""
        network = self.network(arguments.pop("look", LOOK), arguments.pop("other", OTHER), **arguments)
        field = network.field(plain(first, size), plain(second, size))
        self.assertEqual((field.shape, field.dtype), ((*size, 2), np.float32))
        self.assertTrue(np.array_equal(field, np.broadcast_to(field[0, 0], field.shape)))
        return field[0, 0].tolist()

    def disparity(self, left, right, size=SIZE, weight=1.0, **arguments):
        """(H, W) of images."""
        network = self.network([[weight, 0, 0]], [[0, 0, 0]], kind="disparity", **arguments)
        field = network.field(left, right)
        self.assertEqual((field.shape, field.dtype), ((*size, 1), np.float32))
        return field[:, :, 0]

    def test_channels_are_in_their_order(self):
        self.assertEqual(self.flow(), [10 + 10 * 7, 2 * 20])
        self.assertEqual(self.flow(input={"colour": "bgr"}), [31 + 10 * 5, 2 * 20])

    def test_one_input_has_the_channels_of_both_images(self):
        self.assertEqual(self.flow(separate=False), [10 + 10 * 7, 2 * 20])

    def test_inputs_are_in_the_order_of_their_names(self):
        self.assertEqual(self.flow(input={"names": ["a", "b"]}), [10 + 10 * 7, 2 * 20])
        self.assertEqual(self.flow(input={"names": ["b", "a"]}), [5 + 10 * 31, 2 * 6])
        self.assertEqual(self.flow(separate=False, input={"names": "images"}), [10 + 10 * 7, 2 * 20])

    def test_the_last_output_counts_unless_one_is_named(self):
        self.assertEqual(self.flow(last="Neg"), [-80, -40])
        self.assertEqual(self.flow(last="Neg", output={"name": "sums"}), [80, 40])

    def test_values_may_be_the_last_dimension(self):
        self.assertEqual(self.flow(layout="nhwc"), [80, 40])

    def test_grey_images_have_one_channel(self):
        grey = {"look": [[1], [0]], "other": [[0], [1]], "input": {"colour": "grey"}}
        self.assertEqual(self.flow((50, 50, 50), (60, 60, 60), **grey), [50, 60])
        self.assertEqual(self.flow((100, 0, 0), (0, 100, 0), **grey), [30, 59], "0.299 red, 0.587 green")
        self.assertEqual(self.flow((50, 50, 50), (60, 60, 60), separate=False, **grey), [50, 60])

    def test_normalisation(self):
        entry = {"divide_by": 2, "mean": [1, 2, 3], "deviation": [4, 2, 0.125]}
        self.assertEqual(self.flow(input=entry),
                         [(10 / 2 - 1) / 4 + 10 * (7 / 2 - 3) / 0.125, 2 * (20 / 2 - 2) / 2])

    def test_flow_is_scaled_to_the_image(self):
        self.assertEqual(self.flow(size=(80, 240)), [4 * 80, 2 * 40])
        self.assertEqual(self.flow(size=(20, 15)), [80 / 4, 40 / 2])

    def test_smaller_and_larger_outputs_in_px_of_the_input(self):
        for sizes in ({"smaller": 4}, {"larger": 2}):
            for more in ({}, {"output": {"unit": "input"}}):
                self.assertEqual(self.flow(size=(80, 240), **sizes, **more), [4 * 80, 2 * 40], sizes)

    def test_smaller_and_larger_outputs_in_their_own_px(self):
        unit = {"output": {"unit": "output"}}
        self.assertEqual(self.flow(size=(80, 240), smaller=4, **unit), [16 * 80, 8 * 40])
        self.assertEqual(self.flow(size=(80, 240), larger=2, **unit), [2 * 80, 40])

    def test_sign_of_flow(self):
        self.assertEqual(self.flow(output={"sign": -1}), [-80, -40])

    def test_disparity_is_scaled_by_the_width(self):
        for shape in ("nchw", "nhwc", "chw", "hw"):
            for scale, size, unit in ((4, (80, 240), "input"), (16, (80, 240), "output"),
                                      (0.5, (10, 30), "input")):
                found = self.disparity(plain(FIRST, size), plain(SECOND, size), size, layout=shape,
                                       smaller=4, output={"unit": unit})
                self.assertTrue(np.array_equal(found, np.full(size, scale * 10)), (shape, scale))

    def test_places_stay_when_the_image_is_stretched(self):
        size = (80, 240)
        found = self.disparity(halves((8, 0, 0), (16, 0, 0), size), plain(SECOND, size), size, smaller=2)
        self.assertTrue(np.array_equal(found[:, :112], np.full((80, 112), 4 * 8)))
        self.assertTrue(np.array_equal(found[:, 128:], np.full((80, 112), 4 * 16)))
        self.assertTrue(np.all(np.diff(found, axis=1) >= 0))
        self.assertGreater(len(np.unique(found)), 4, "linear between both")

    def test_negative_disparities_count_with_sign_minus_one(self):
        images = plain(FIRST), plain(SECOND)
        self.assertTrue(np.all(self.disparity(*images, weight=-1, output={"sign": -1}) == 10))
        self.assertTrue(np.isnan(self.disparity(*images, weight=-1)).all())
        self.assertTrue(np.isnan(self.disparity(*images, output={"sign": -1})).all())

    def test_unknown_disparity_does_not_mix_with_the_rest(self):
        """At the left: no number, zero, negative values. At the right: 2 px of the input."""
        size = (80, 240)
        for last, bias, colours in (("Sqrt", -10, (4, 14)), ("Relu", -10, (3, 12)),
                                    ("Reciprocal", -0.5, (0, 1)), ("Identity", -10, (0, 12))):
            image = halves((colours[0], 0, 0), (colours[1], 0, 0), size)
            found = self.disparity(image, image, size, last=last, bias=bias)
            known = found[np.isfinite(found)]
            self.assertTrue(np.array_equal(known, np.full(len(known), 4 * 2)), last)
            self.assertTrue(np.isfinite(found[:, 128:]).all(), last)
            self.assertTrue(np.isnan(found[:, :112]).all(), last)

    def test_flow_without_a_value_is_unknown_in_both_directions(self):
        """u is 1 / red: infinite at the left, 1 at the right; v is 1."""
        image = halves((0, 1, 0), (1, 1, 0))
        network = self.network([[1, 0, 0], [0, 1, 0]], np.zeros((2, 3)), last="Reciprocal")
        found = network.field(image, image)
        self.assertTrue(np.isnan(found[:, :30]).all())
        self.assertTrue(np.all(found[:, 30:] == 1))

    def test_values_that_no_image_has_are_unknown(self):
        for weight, known in ((9e3, True), (1e4, False)):
            found = self.disparity(plain(FIRST), plain(SECOND), weight=weight)
            self.assertEqual(np.isfinite(found).all(), known, weight)


@unittest.skipIf(MISSING, MISSING)
class Files(Case):
    """Folders of images become folders of fields."""

    def images(self, name="image_0", count=3):
        """Red is 1, 2, ..., and green 1 everywhere."""
        return write_images(self.folder / name, [plain((1 + t, 1, 0)) for t in range(count)])

    def flow(self, network, images, **arguments):
        return fields_onnx.make_flow(network, images, self.folder / "flow", self.folder / "back",
                                     **arguments)

    def flow_network(self, red=1, **arguments):
        """u: red of the first image less 10 times red of the second; v: green."""
        return self.network([[red, 0, 0], [0, 1, 0]], [[-10, 0, 0], [0, 0, 0]], **arguments)

    def stereo_network(self, **arguments):
        """Red of the first image, 3 times red of the second, and the column."""
        return self.network([[1, 0, 0]], [[3, 0, 0]], kind="disparity", ramp=1, **arguments)

    def test_flow_forward_and_back_has_the_name_of_the_earlier_frame(self):
        made = self.flow(self.flow_network(), self.images())
        self.assertEqual((made["fields"], made["made"]), (4, 4))
        for folder, values in (("flow", (1 - 20, 2 - 30)), ("back", (2 - 10, 3 - 20))):
            self.assertEqual(sorted(p.name for p in (self.folder / folder).glob("*.flo")),
                             ["000000.flo", "000001.flo"])
            for t, value in enumerate(values):
                found = read_flo(self.folder / folder / f"{t:06d}.flo")
                self.assertTrue(np.array_equal(found, np.broadcast_to((value, 1), (*SIZE, 2))), folder)
            self.assertEqual((self.folder / folder / "images.txt").read_text(), "image_0\n")

    def test_flow_without_backward_flow(self):
        made = fields_onnx.make_flow(self.flow_network(), self.images(), self.folder / "flow")
        self.assertEqual(made["fields"], 2)
        self.assertFalse((self.folder / "back").exists())

    def test_a_single_image_has_no_flow(self):
        made = self.flow(self.flow_network(), self.images(count=1))
        self.assertEqual(made, {"fields": 0, "made": 0, "seconds": 0})

    def test_unknown_flow_is_no_number_in_the_file(self):
        images = write_images(self.folder / "image_0", [halves((0, 1, 0), (1, 1, 0))] * 2)
        network = self.network([[1, 0, 0], [0, 1, 0]], np.zeros((2, 3)), last="Reciprocal")
        self.flow(network, images)
        found = read_flo(self.folder / "flow" / "000000.flo")
        self.assertTrue(np.isnan(found[:, :30]).all())
        self.assertTrue(np.all(found[:, 30:] == 1))

    def stereo(self, network, left, right, **arguments):
        """Disparity of lists of RGB images, left and right; what make_disparity() returns."""
        pairs = fields_onnx.common.partners(write_images(self.folder / "image_0", left),
                                            write_images(self.folder / "image_1", right))
        return fields_onnx.make_disparity(network, pairs, self.folder / "left", self.folder / "right",
                                          **arguments)

    def test_right_disparity_is_that_of_the_flipped_images(self):
        random = np.random.default_rng(5)
        left, right = random.integers(1, 50, (2, *SIZE, 3)).astype(np.uint8)
        made = self.stereo(self.stereo_network(), [left], [right])
        self.assertEqual((made["fields"], made["made"]), (2, 2))
        column = np.arange(SIZE[1])
        red_left, red_right = left[:, :, 0].astype(int), right[:, :, 0].astype(int)
        for folder, expected in (("left", red_left + 3 * red_right + column),
                                 ("right", red_right + 3 * red_left + SIZE[1] - 1 - column)):
            found = read_pfm(self.folder / folder / "000000.pfm")
            self.assertTrue(np.array_equal(found, expected), folder)
        for folder, images in (("left", "image_0\n"), ("right", "image_1\n")):
            self.assertEqual((self.folder / folder / "images.txt").read_text(), images)

    def test_unknown_disparity_is_0_in_the_file(self):
        image = halves((9, 0, 0), (12, 0, 0))
        network = self.network([[1, 0, 0]], [[0, 0, 0]], kind="disparity", last="Sqrt", bias=-11)
        self.stereo(network, [image], [image])
        for folder in ("left", "right"):
            found = read_pfm(self.folder / folder / "000000.pfm")
            self.assertTrue(np.all(found[:, :30] == 0) and np.all(found[:, 30:] == 1), folder)

    def test_a_second_run_keeps_what_is_there(self):
        images = self.images(count=4)
        first = self.flow(self.flow_network(), images)
        self.assertEqual(first["made"], 6)
        self.assertGreater(first["seconds"], 0)
        self.assertEqual(self.flow(self.flow_network(), images), {**first, "made": 0}, "times as well")
        self.assertEqual(self.flow(self.flow_network(), images, overwrite=True)["made"], 6)

    def test_what_is_of_something_else_is_made_again(self):
        images = self.images(count=4)
        self.flow(self.flow_network(), images)
        write_images(self.folder / "image_0", [plain((t, 1, 0)) for t in (1, 2, 3, 9)])
        self.assertEqual(self.flow(self.flow_network(), images)["made"], 2, "another last image")
        self.assertEqual(self.flow(self.flow_network(red=2), images)["made"], 6, "other weights")
        found = read_flo(self.folder / "flow" / "000000.flo")
        self.assertEqual(found[0, 0].tolist(), [2 * 1 - 10 * 2, 1])
        network = self.flow_network(red=2, output={"sign": -1})
        self.assertEqual(self.flow(network, images)["made"], 6, "other settings")
        for name, other in (("flow", "x"), ("back", "flow"), ("x", "back")):
            (self.folder / name).rename(self.folder / other)
        made = self.flow(network, images)
        self.assertEqual(made["made"], 6, "the other direction")

    def test_disparity_of_one_side_is_not_kept_as_that_of_the_other(self):
        image = plain(FIRST)
        network = self.stereo_network()
        self.assertEqual(self.stereo(network, [image], [image])["made"], 2)
        self.assertEqual(self.stereo(network, [image], [image])["made"], 0)
        files = [self.folder / side / name for name in ("000000.pfm", ".notes/000000.pfm.json")
                 for side in ("left", "right")]
        contents = [file.read_bytes() for file in files]
        for k, file in enumerate(files):
            file.write_bytes(contents[k ^ 1])  # left and right exchanged
        self.assertEqual(self.stereo(network, [image], [image])["made"], 2)

    def test_damaged_files_and_notes_are_made_again(self):
        images = self.images()
        self.flow(self.flow_network(), images)
        for name in ("000001.flo", ".notes/000001.flo.json"):
            whole = (self.folder / "flow" / "000001.flo").read_bytes()
            for content in (b"", b"[]", b'{"made_of": 1}', b"\xff"):
                (self.folder / "flow" / name).write_bytes(content)
                self.assertEqual(self.flow(self.flow_network(), images)["made"], 1, (name, content))
                self.assertEqual((self.folder / "flow" / "000001.flo").read_bytes(), whole)

    def test_any_number_of_threads_gives_the_same_files(self):
        random = np.random.default_rng(7)
        images = write_images(self.folder / "image_0",
                              list(random.integers(0, 255, (6, 50, 70, 3)).astype(np.uint8)))
        network = self.network(LOOK, OTHER, smaller=2, input={"gamma": 0.7})
        names = [f"{folder}/{t:06d}.flo" for folder in ("flow", "back") for t in range(5)]
        contents = []
        for jobs in (1, 4):
            self.assertEqual(self.flow(network, images, overwrite=True, jobs=jobs)["made"], 10)
            contents.append([(self.folder / name).read_bytes() for name in names])
        self.assertEqual(*contents)
        self.assertEqual(len(set(contents[0])), 10)

    def test_images_that_do_not_fit(self):
        images = self.images()
        cv2.imwrite(str(images[1]), np.zeros((30, 61, 3), np.uint8))
        self.refused("000001.png: is 61x30", self.flow, self.flow_network(), images, jobs=1)
        images[1].write_bytes(b"no image")
        self.refused("000001.png: cannot read", self.flow, self.flow_network(), images, jobs=2)
        self.assertEqual(list(self.folder.rglob("*.tmp")), [])
        self.refused("000002.png: has no partner", fields_onnx.common.partners, images, self.images("other", 2))

    def test_fields_without_any_value_are_refused(self):
        image = plain(FIRST)
        network = self.stereo_network(output={"sign": -1})
        self.refused("no positive disparity (output.sign)", self.stereo, network, [image], [image])
        network = self.network(LOOK, OTHER, last="Sqrt", bias=-1000)
        self.refused("fields.yaml: the network gives no finite flow", self.flow, network, self.images())
        bright = halves((9, 0, 0), (12, 0, 0))
        network = self.network([[1, 0, 0]], [[0, 0, 0]], kind="disparity", bias=-11)
        made = self.stereo(network, [image, bright], [image, bright])
        self.assertEqual(made["made"], 4, "one image may be without")

    def test_the_program_writes_flow(self):
        self.flow_network()
        self.images()
        arguments = (self.folder / "image_0", "--model", self.folder / "fields.yaml", "--output",
                     self.folder / "flow", "--backward", self.folder / "back")
        for said in ("4 fields, 0 kept, network", "0 fields, 4 kept, network"):
            done = self.call(*arguments)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn(said, done.stdout)
        self.assertEqual(read_flo(self.folder / "back" / "000000.flo")[0, 0].tolist(), [2 - 10, 1])
        self.assertIn("4 fields, 0 kept", self.call(*arguments, "--overwrite").stdout)

    def test_the_program_writes_disparity_with_other_weights(self):
        self.network([[1, 0, 0]], [[0, 0, 0]], kind="disparity")
        self.network([[2, 0, 0]], [[0, 0, 0]], kind="disparity", name="double")
        for name in ("image_0", "image_1"):
            self.images(name)
        done = self.call(self.folder / "image_0", self.folder / "image_1", "--model",
                         self.folder / "fields.yaml", "--weights", self.folder / "double.onnx",
                         "--output", self.folder / "left", "--right", self.folder / "right")
        self.assertEqual(done.returncode, 0, done.stderr)
        for side in ("left", "right"):
            self.assertTrue(np.all(read_pfm(self.folder / side / "000002.pfm") == 2 * 3))

    def test_wrong_calls_end_with_status_2_and_one_line(self):
        self.flow_network()
        self.network([[1, 0, 0]], [[0, 0, 0]], kind="disparity", name="stereo")
        images = self.images()[0].parent
        flow, stereo = (self.folder / f"{name}.yaml" for name in ("fields", "stereo"))
        for arguments, text in (
                ((self.folder / "none", "--model", flow), "none: is not a folder"),
                ((images, "--model", self.folder / "none.yaml"), "none.yaml: "),
                ((images, "--model", flow, "--weights", flow), "fields.yaml: cannot be loaded"),
                ((images, images, "--model", flow), "kind is 'flow', which takes one folder"),
                ((images, "--model", stereo), "kind is 'disparity', which takes two folders"),
                ((images, "--model", flow, "--right", "x"), "--right does not apply to kind 'flow'"),
                ((images, images, "--model", stereo, "--backward", "x"), "--backward does not apply")):
            done = self.call(*arguments, "--output", self.folder / "out")
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
            self.assertIn(text, done.stderr)
        self.assertFalse((self.folder / "out").exists())


@unittest.skipIf(MISSING, MISSING)
class Settings(Case):
    """What is wrong with a YAML file or does not agree with its network: one line."""

    def load(self, **changes):
        return fields_onnx.FieldNetwork(write_settings(self.folder, **changes))

    def test_settings_that_make_no_sense(self):
        write_fields_network(self.folder, LOOK, OTHER)
        self.load()
        for changes, text in (
                ({"kind": "semantic"}, "kind is 'semantic', not one of flow, disparity"),
                ({"kind": ["flow"]}, "kind is '['flow']'"),
                ({"kinds": 1}, "kinds is not one of file, kind, input"),
                ({"input": {"colour": "red"}}, "input.colour is 'red', not one of rgb, bgr, grey"),
                ({"input": {"divide": 5}}, "input.divide is not one of size, colour"),
                ({"input": {"size": [0, 5]}}, "input.size is '[0, 5]'"),
                ({"input": {"divide_by": 0}}, "input.divide_by is 0"),
                ({"input": {"mean": [1, 2]}}, "fields.yaml: "),
                ({"input": {"deviation": "x"}}, "input.deviation is 'x'"),
                ({"output": {"sign": 2}}, "output.sign is '2', not one of 1, -1"),
                ({"output": {"unit": "metre"}}, "output.unit is 'metre', not one of input, output"),
                ({"output": {"names": "x"}}, "output.names is not one of name, unit, sign"),
                ({"output": {"name": "x"}}, "output.name is 'x', the network has sums, field"),
                ({"output": 5}, "output is '5'"),
                ({"file": "none.onnx"}, "none.onnx: cannot be loaded")):
            self.refused(text, self.load, **changes)
        for document, text in (({"kind": "flow"}, "input.size is missing"),
                               ({"input": {"size": [4, 5]}}, "kind is missing"), (5, "is not a list"),
                               ({"kind": "flow", "input": 5}, "input is '5'")):
            path = self.folder / "fields.yaml"
            path.write_text(yaml.safe_dump(document))
            self.refused(text, fields_onnx.FieldNetwork, path)
        path.write_bytes(b"\xff\xfe\x00")
        self.refused("fields.yaml", fields_onnx.FieldNetwork, path)

    def test_examples_in_the_documents(self):
        text = (ROOT / "tools" / "perception" / "README.md").read_text(encoding="utf-8")
        blocks = [block for block in text.split("\n\n") if block.startswith("    file:")]
        self.assertEqual(len(blocks), 2)
        raft, stereo = (yaml.safe_load(block) for block in blocks)
        for document, inputs, planes, output in ((raft, ("image1", "image2"), 3, [1, 2, 376, 1240]),
                                                 (stereo, ("images",), 2, [1, 1, 96, 312])):
            size = document["input"]["size"]
            plane = onnx.numpy_helper.from_array(np.full(output, -3, np.float32), "plane")
            write_graph(self.folder / document["file"],
                        [onnx.helper.make_node("Identity", ["plane"], ["flow"])],
                        {name: [1, planes, *size] for name in inputs}, {"flow": output}, [plane])
            path = self.folder / "example.yaml"
            path.write_text(yaml.safe_dump(document))
            network = fields_onnx.FieldNetwork(path)
            found = network.field(plain(FIRST, size), plain(SECOND, size))
            self.assertTrue(np.all(found == (-3 if document is raft else 4 * 3)))
            limits = network.prepare(halves((0, 0, 0), (255, 255, 255), size))
            self.assertEqual((limits.min(), limits.max()), (-1 if document is raft else 0, 1))

    def test_another_kind_than_wanted(self):
        path = write_fields_network(self.folder, LOOK, OTHER)
        self.assertEqual(fields_onnx.FieldNetwork(path, wanted="flow").kind, "flow")
        self.refused("kind is 'flow', not disparity", fields_onnx.FieldNetwork, path, wanted="disparity")

    def test_inputs_that_the_network_does_not_have(self):
        write_fields_network(self.folder, LOOK, OTHER)
        for names in (["a"], ["a", "c"], ["a", "a"], ["a", "b", "c"], "a", []):
            self.refused("the network has a, b", self.load, input={"names": names})
        self.refused("input 'a' is (1, 3, 40, 60), not (1, 3, 40, 64)", self.load, size=(40, 64))
        self.refused("not (1, 1, 40, 60)", self.load, input={"colour": "grey"})
        write_fields_network(self.folder, LOOK, OTHER, separate=False)
        self.refused("is (1, 6, 40, 60), not (1, 2, 40, 60)", self.load, input={"colour": "grey"})
        shape = [1, 3, *SIZE]
        write_graph(self.folder / "fields.onnx", [onnx.helper.make_node("Sum", ["a", "b", "c"], ["d"])],
                    dict.fromkeys("abc", shape), {"d": shape}, [])
        self.refused("fields.onnx: has 3 inputs (a, b, c)", self.load)

    def test_names_that_are_numbers(self):
        shape = [1, 3, *SIZE]
        write_graph(self.folder / "fields.onnx",
                    [onnx.helper.make_node("Sub", ["0", "1"], ["5"]),
                     onnx.helper.make_node("Slice", ["5", "start", "end", "axis"], ["6"])],
                    {"0": shape, "1": shape}, {"6": [1, 2, *SIZE], "5": shape},
                    [onnx.numpy_helper.from_array(np.array([value], np.int64), name)
                     for name, value in (("start", 0), ("end", 2), ("axis", 1))])
        network = self.load(input={"names": [1, 0]}, output={"name": 6})
        found = network.field(plain(FIRST), plain(SECOND))
        self.assertEqual(found[0, 0].tolist(), [5 - 10, 6 - 20])

    def write_ones(self, shape, stated):
        """A network that gives ones of this shape for black images, and states another one."""
        node = onnx.helper.make_node
        constants = [onnx.numpy_helper.from_array(np.array(value, np.int64), name)
                     for name, value in (("shape", shape), ("axes", [0, 1, 2, 3]))]
        nodes = [node("Add", ["a", "b"], ["both"]),
                 node("ReduceSum", ["both", "axes"], ["sum"], keepdims=0),
                 node("Cast", ["sum"], ["whole"], to=onnx.TensorProto.INT64),
                 node("Add", ["shape", "whole"], ["size"]),
                 node("ConstantOfShape", ["size"], ["field"],
                      value=onnx.numpy_helper.from_array(np.ones(1, np.float32)))]
        write_graph(self.folder / "fields.onnx", nodes, dict.fromkeys("ab", [1, 3, *SIZE]),
                    {"field": stated}, constants)

    def test_outputs_of_other_shapes(self):
        images = plain((0, 0, 0)), plain((0, 0, 0))
        of_flow = [1, 3, 8, 9], [2, 2, 8, 9], [2, 8, 9], [1, 1, 8, 9], [1, 2, 0, 9]
        of_disparity = [1, 2, 8, 9], [2, 8, 9], [2, 1, 8, 9], [1, 1, 1, 8, 9], [9], [8, 0]
        for kind, shapes in (("flow", of_flow), ("disparity", of_disparity)):
            for shape in shapes:
                text = f"output 'field' is ({', '.join(map(str, shape))}), not (1, "
                self.write_ones(shape, shape)
                self.refused(text, self.load, kind=kind)
                self.write_ones(shape, [f"side{k}" for k in range(len(shape))])
                network = self.load(kind=kind)
                self.refused(text, network.field, *images)
        for kind, shape in (("flow", [1, 2, 8, 9]), ("flow", [1, 8, 9, 2]), ("disparity", [8, 9])):
            self.write_ones(shape, [f"side{k}" for k in range(len(shape))])
            self.assertTrue(np.all(self.load(kind=kind).field(*images) == 1))

    def test_outputs_that_are_no_numbers(self):
        network = fields_onnx.FieldNetwork(write_fields_network(self.folder, LOOK, OTHER))
        network.session = unittest.mock.Mock(run=lambda *_: [np.full((1, 2, *SIZE), "text")])
        self.refused("fields.yaml: output 'field': could not convert", network.field, plain(FIRST),
                     plain(SECOND))

    def test_a_size_that_only_the_run_finds_wrong(self):
        """The network leaves the size open, but adds a plane of 40x60 px."""
        plane = onnx.numpy_helper.from_array(np.zeros((1, 3, *SIZE), np.float32), "plane")
        node = onnx.helper.make_node
        write_graph(self.folder / "fields.onnx",
                    [node("Add", ["a", "plane"], ["c"]), node("Add", ["b", "c"], ["d"]),
                     node("ReduceMean", ["d"], ["field"], axes=[1])],
                    dict.fromkeys("ab", [1, 3, "h", "w"]), {"field": [1, 1, "h", "w"]}, [plane])
        network = self.load(kind="disparity", size=(40, 64))
        text = "fields.onnx: takes no images of 64x40 px (input.size of"
        self.refused(text, network.field, plain(FIRST), plain(SECOND))
        images = write_images(self.folder / "images", [plain(FIRST)])[0].parent
        done = self.call(images, images, "--model", self.folder / "fields.yaml", "--output",
                         self.folder / "out")
        self.assertEqual(done.returncode, 2)
        self.assertIn(text, done.stderr.splitlines()[-1])
        self.assertNotIn("E:onnxruntime", done.stderr, "no message beside that one")


@unittest.skipIf(MISSING, MISSING)
@unittest.skipUnless(BUILDER, "KYS_BUILD_PRIORS is not set")
class Priors(Case):
    """make_priors with networks for stereo and flow."""

    def setUp(self):
        super().setUp()
        self.sequence = write_sequence(self.folder / "sequence")
        self.model = write_network(self.folder)
        self.stereo = write_fields_network(self.folder, [[0.5]], [[0]], "disparity", last="Ceil",
                                           name="stereo", input={"colour": "grey", "divide_by": 255})
        self.write_flow(0)

    def write_flow(self, value):
        """The same flow everywhere, px."""
        self.flow = write_fields_network(self.folder, np.zeros((2, 3)), np.zeros((2, 3)), bias=value,
                                         name="flow")

    def make(self, *more):
        return onnx_support.make_priors(self.sequence, self.model, self.folder / "made", *more)

    def both(self):
        return ("--stereo-model", self.stereo, "--flow-model", self.flow)

    def segments(self):
        """Rows of the things of the first two frames, which have flow."""
        with open(self.folder / "made" / "priors" / "segments.csv", encoding="utf-8") as file:
            rows = [row for row in csv.DictReader(file) if row["frame"] != "000002"]
        self.assertEqual(len(rows), 8)
        return rows

    def times(self):
        times = json.loads((self.folder / "made" / "times.json").read_text())
        times.pop("validate")
        return times

    def test_from_images_to_prior_files(self):
        """Disparity is 4 px everywhere: 1 px of the input, of a quarter of the width. Stereo matching
        would find 8 and 14 px of the things."""
        done = self.make(*self.both())
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("3 built, 0 kept", done.stdout)
        self.assertIn("frames 3, sound 3, missing 0", done.stdout)
        self.assertRegex(done.stdout, r"stereo \d+ ms per disparity field, flow \d+ ms per flow field")
        made = self.folder / "made"
        for side in ("left", "right"):
            self.assertTrue(np.all(read_pfm(made / "disparity" / side / "000002.pfm") == 4))
            for folder in ("flow", "flow_back"):
                self.assertEqual(sorted(p.name for p in (made / folder / side).glob("*.flo")),
                                 ["000000.flo", "000001.flo"])
        for row in self.segments():
            self.assertAlmostEqual(float(row["mean_depth_m"]), 50 / 4, places=3)
            self.assertGreater(float(row["coverage"]), 0.5)
        times = self.times()
        self.assertEqual([times[name] for name in ("segmented images", "stereo fields", "flow fields")],
                         [6, 6, 8])
        self.assertGreater(min(times["stereo"], times["flow"]), 0)
        done = self.make(*self.both())
        self.assertIn("0 built, 3 kept", done.stdout)
        self.assertEqual(self.times(), times)

    def test_folders_of_the_builder(self):
        both = make_priors.field_arguments({"stereo": None, "flow": None}, Path("a"))
        self.assertEqual(" ".join(both), "--disparity a/disparity/left "
                         "--disparity-right a/disparity/right --flow-left a/flow/left "
                         "--flow-back-left a/flow_back/left --flow-right a/flow/right "
                         "--flow-back-right a/flow_back/right")
        none = make_priors.field_arguments({}, Path("a"))
        self.assertEqual(" ".join(none), "--disparity sgbm --flow-left dis --flow-right dis")

    def test_flow_back_is_compared_with_flow(self):
        """Flow of 5 px forward and 5 px back, not -5: none is believed."""
        self.assertEqual(self.make(*self.both()).returncode, 0)
        self.write_flow(5)
        done = self.make(*self.both())
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("3 built, 0 kept", done.stdout)
        self.assertEqual({float(row["coverage"]) for row in self.segments()}, {0})

    def test_one_of_both_networks_and_one_frame(self):
        made = self.folder / "made"
        for arguments, folders, name, count in (
                (("--stereo-model", self.stereo), {"disparity"}, "stereo", 6),
                (("--flow-model", self.flow, "--frames", "1"), {"flow", "flow_back"}, "flow", 0)):
            done = self.make(*arguments)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual({p.name for p in made.iterdir() if p.is_dir()},
                             {"panoptic", "priors", *folders})
            times = self.times()
            self.assertEqual({n for n in times if n.endswith("fields")}, {f"{name} fields"})
            self.assertEqual(times[f"{name} fields"], count)
            made.rename(self.folder / name)

    def test_weights_of_options(self):
        write_fields_network(self.folder, [[0]], [[0]], "disparity", bias=2, name="two",
                             input={"colour": "grey"})
        write_fields_network(self.folder, np.zeros((2, 3)), np.zeros((2, 3)), bias=3, name="three")
        done = self.make(*self.both(), "--stereo-weights", self.folder / "two.onnx", "--flow-weights",
                         self.folder / "three.onnx")
        self.assertEqual(done.returncode, 0, done.stderr)
        made = self.folder / "made"
        self.assertTrue(np.all(read_pfm(made / "disparity" / "left" / "000000.pfm") == 4 * 2))
        self.assertEqual(read_flo(made / "flow" / "right" / "000000.flo")[0, 0].tolist(), [4 * 3, 2 * 3])

    def test_what_is_wrong_is_refused_before_a_network_runs(self):
        wrong = write_settings(self.folder, name="wrong", kind="none")
        for arguments, text in (
                (("--stereo-model", wrong), "wrong.yaml: kind is 'none'"),
                (("--flow-model", wrong), "wrong.yaml: kind is 'none'"),
                (("--stereo-model", self.flow), "flow.yaml: kind is 'flow', not disparity"),
                (("--flow-model", self.stereo), "stereo.yaml: kind is 'disparity', not flow"),
                (("--stereo-weights", self.flow), "--stereo-weights needs --stereo-model"),
                (("--flow-weights", self.flow), "--flow-weights needs --flow-model"),
                ((*self.both(), "--flow-weights", self.folder / "none"), "none: cannot be loaded"),
                ((*self.both(), "--", "--set", "no.such=1"), "no.such")):
            done = self.make(*arguments)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
            self.assertIn(text, done.stderr)
        self.assertFalse((self.folder / "made").exists())


if __name__ == "__main__":
    unittest.main()
