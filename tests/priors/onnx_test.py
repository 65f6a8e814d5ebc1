# SPDX-License-Identifier: BSD-3-Clause
"""Segmentation by ONNX Runtime and the way from images to prior files, with a tiny network made here;
with the real one where it is (KYS_REAL_PERCEPTION). Skipped without onnxruntime, onnx, cv2, yaml."""

import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

import onnx_support  # makes the modules below known
from onnx_support import BUILDER, MISSING, ROOT, SETTINGS, cv2, write_network, write_sequence
import kysp
import segment_onnx

REAL = Path(os.environ.get("KYS_REAL_PERCEPTION",
                           ROOT.parent / "shared" / "data" / "real_perception"))


@unittest.skipIf(MISSING, MISSING)
class Onnx(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)

    def segment(self, network, **arguments):
        images = segment_onnx.common.list_images(self.folder / "sequence" / "image_0")
        return segment_onnx.segment_folder(network, images, self.folder / "out", **arguments)

    def test_classes_become_instances_and_a_second_run_keeps_them(self):
        write_sequence(self.folder / "sequence")
        network = segment_onnx.Network(write_network(self.folder))
        self.assertEqual(self.segment(network)["frames"], 3)
        ids = cv2.imread(str(self.folder / "out" / "000001.png"))[:, :, 2]
        document = json.loads((self.folder / "out.json").read_text())
        segments = document["annotations"][1]["segments_info"]
        self.assertEqual([s["category_id"] for s in segments], [7, 26, 26])
        self.assertNotEqual(ids[45, 55], ids[45, 175])
        self.assertEqual(ids[10, 10], 1)
        for segment in segments:
            self.assertEqual(segment["area"], np.count_nonzero(ids == segment["id"]))
        self.assertAlmostEqual(segments[1]["area"], 30 * 50, delta=300)
        self.assertEqual(self.segment(network)["frames"], 0)

    def test_other_weights_of_the_same_name_make_other_maps(self):
        write_sequence(self.folder / "sequence")
        for scale, made in ((1.0, 3), (1.0, 0), (0.5, 3)):
            network = segment_onnx.Network(write_network(self.folder, scale))
            self.assertEqual(self.segment(network)["frames"], made)

    def test_other_images_of_the_same_name_make_other_maps(self):
        sequence = write_sequence(self.folder / "sequence")
        network = segment_onnx.Network(write_network(self.folder))
        self.assertEqual(self.segment(network)["frames"], 3)
        changed = sequence / "image_0" / "000001.png"
        image = cv2.imread(str(changed))
        image[30:60] = 0
        cv2.imwrite(str(changed), image)
        self.assertEqual(self.segment(network)["frames"], 1)
        self.assertEqual(self.segment(network)["frames"], 0)
        document = json.loads((self.folder / "out.json").read_text())
        self.assertEqual([len(a["segments_info"]) for a in document["annotations"]], [3, 1, 3])

    def test_damaged_maps_and_notes_are_made_again(self):
        write_sequence(self.folder / "sequence")
        network = segment_onnx.Network(write_network(self.folder))
        self.segment(network)
        whole = (self.folder / "out.json").read_bytes()
        for name in ("out/000001.png", "out/.notes/000001.png.json"):
            for content in (b"", b"[]", b'{"made_of": 1}', b"\xff"):
                (self.folder / name).write_bytes(content)
                self.assertEqual(self.segment(network)["frames"], 1, (name, content))
        self.assertEqual((self.folder / "out.json").read_bytes(), whole)

    def test_times_of_kept_maps_are_those_of_their_making(self):
        write_sequence(self.folder / "sequence")
        network = segment_onnx.Network(write_network(self.folder))
        first, second = self.segment(network), self.segment(network)
        self.assertGreater(first["network"], 0)
        self.assertEqual({**first, "frames": 0}, second)

    def test_images_are_in_the_order_of_their_numbers(self):
        names = ["a1.5", "a1.10", "a2", "a10", "b01.x", "b1.y", "b10"]
        for name in reversed(names):
            (self.folder / f"{name}.png").touch()
        listed = segment_onnx.common.list_images(self.folder)
        self.assertEqual([f.stem for f in listed], ["a1.10", "a1.5", *names[2:]])

    def test_settings_that_make_no_sense(self):
        """One line that names the YAML file."""
        entry = SETTINGS["input"]
        wrong = [{"input": {**entry, "size": size}} for size in (5, [5], [0, 5], ["x", 5], [5.5, 5])]
        wrong += [{"input": {**entry, key: value}} for key, value in (
            ("divide_by", 0), ("divide_by", "x"), ("mean", [1, 2]), ("mean", "x"), ("deviation", 0),
            ("gamma", "x"), ("gamma", -1))]
        wrong += [{"output": {"kind": "semantic", "min_score": "x"}}, {"output": 5}, {"input": 5},
                  {"output": {"kind": "panoptic", "divisor": 0}}, {"classes": 5}, {"classes": [["a"]]},
                  {"label_space": "none"}, {"label_space": 5}]
        for changes in wrong:
            with self.assertRaises(segment_onnx.common.InputError, msg=changes) as ended:
                segment_onnx.Network(write_network(self.folder, **changes))
            if changes != {"label_space": "none"}:
                self.assertIn("tiny.yaml", str(ended.exception))
        file = write_network(self.folder)
        file.write_bytes(b"\xff\xfe\x00")
        with self.assertRaisesRegex(segment_onnx.common.InputError, "tiny.yaml"):
            segment_onnx.Network(file)

    def test_images_that_the_network_does_not_fit(self):
        write_sequence(self.folder / "sequence")
        network = segment_onnx.Network(write_network(
            self.folder, input={**SETTINGS["input"], "size": [40, 60]}))
        with self.assertRaisesRegex(segment_onnx.common.InputError, "tiny.onnx.*60x40"):
            self.segment(network)

    def test_any_number_of_threads_gives_the_same_files(self):
        write_sequence(self.folder / "sequence")
        network = segment_onnx.Network(write_network(self.folder))
        self.segment(network)
        names = [f"out/{i:06d}.png" for i in range(3)] + ["out.json"]
        single = [(self.folder / name).read_bytes() for name in names]
        made = self.segment(network, overwrite=True, jobs=3)
        self.assertEqual(made["frames"], 3)
        self.assertEqual([(self.folder / name).read_bytes() for name in names], single)

    def test_an_image_that_cannot_be_read_ends_all_threads(self):
        write_sequence(self.folder / "sequence")
        (self.folder / "sequence" / "image_0" / "000001.png").write_bytes(b"no image")
        network = segment_onnx.Network(write_network(self.folder))
        with self.assertRaises(segment_onnx.common.InputError) as ended:
            self.segment(network, jobs=2)
        self.assertIn("000001.png", str(ended.exception))

    def test_gamma_brightens_before_normalisation(self):
        entry = {**SETTINGS["input"], "gamma": 0.5}
        network = segment_onnx.Network(write_network(self.folder, input=entry))
        image = np.full((40, 120, 3), 64, np.uint8)
        self.assertTrue(np.allclose(network.prepare(image), 127 / 255), "255 sqrt(64 / 255) = 127.7")

    def test_a_weak_thing_is_the_best_of_the_rest(self):
        write_sequence(self.folder / "sequence")
        # Probability of car: 1 / (1 + exp(1 - 2 r)), at most 0.73.
        for threshold, cars in ((0.0, True), (0.9, False)):
            network = segment_onnx.Network(write_network(self.folder), threshold=threshold)
            self.assertEqual(self.segment(network)["frames"], 3, "other settings: anew")
            found = json.loads((self.folder / "out.json").read_text())["annotations"][0]
            self.assertEqual(any(s["category_id"] == 26 for s in found["segments_info"]), cars)
        self.assertEqual(found["segments_info"][0]["area"], 80 * 240, "road instead")

    def test_wrong_settings_are_named(self):
        for changes, text in (({"classes": ["road", "spaceship"]}, "spaceship"),
                              ({"output": {"kind": "guess"}}, "output.kind"),
                              ({"input": {}}, "input.size"), ({"file": "none.onnx"}, "none.onnx")):
            with self.assertRaises(segment_onnx.common.InputError) as caught:
                segment_onnx.Network(write_network(self.folder, **changes))
            self.assertIn(text, str(caught.exception))

    def test_a_missing_input_ends_with_status_2_and_one_line(self):
        settings = write_network(self.folder)
        for images, other in ((self.folder / "none", []), (self.folder, ["--jobs", "2"])):
            done = subprocess.run(
                [sys.executable, ROOT / "tools" / "perception" / "segment_onnx.py", images, "--model", settings,
                 "--output", self.folder / "out", *other],
                capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
            self.assertIn(str(images), done.stderr)

    def make(self, sequence, model, *more):
        """make_priors into "made"."""
        return onnx_support.make_priors(sequence, model, self.folder / "made", *more)

    @unittest.skipUnless(BUILDER, "KYS_BUILD_PRIORS is not set")
    def test_priors_of_some_frames(self):
        sequence = write_sequence(self.folder / "sequence")
        for name in ("image_0", "image_1"):  # 9.png comes before 10.png
            for t in range(3):
                (sequence / name / f"{t:06d}.png").rename(sequence / name / f"{9 + t}.png")
        model = write_network(self.folder)
        for frames, said in (("2", "frames 2, sound 2, missing 0"), ("3", "frames 3, sound 3")):
            done = self.make(sequence, model, "--frames", frames)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn(said, done.stdout)
        self.assertTrue((self.folder / "made" / "priors" / "9.kysp").exists())

    @unittest.skipUnless(BUILDER, "KYS_BUILD_PRIORS is not set")
    def test_one_frame_has_priors_and_no_page(self):
        done = self.make(write_sequence(self.folder / "sequence"), write_network(self.folder), "--frames", "1")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("before the last frame", done.stderr)
        self.assertNotIn("Traceback", done.stderr)
        self.assertIn("no page of decisions", done.stdout)
        self.assertFalse((self.folder / "made" / "decisions.html").exists())

    @unittest.skipUnless(BUILDER, "KYS_BUILD_PRIORS is not set")
    def test_times_of_a_run_that_keeps_everything_stay(self):
        sequence, model = write_sequence(self.folder / "sequence"), write_network(self.folder)
        times = []
        for _ in range(2):
            self.assertEqual(self.make(sequence, model).returncode, 0)
            times.append(json.loads((self.folder / "made" / "times.json").read_text()))
            times[-1].pop("validate")
        self.assertEqual(times[0], times[1])
        self.assertEqual(times[0]["segmented images"], 6)
        self.assertGreater(min(times[0].values()), 0)

    @unittest.skipUnless(BUILDER, "KYS_BUILD_PRIORS is not set")
    def test_another_sequence_replaces_the_first(self):
        model = write_network(self.folder)
        first, second = (write_sequence(self.folder / name) for name in ("a", "b"))
        for name in ("image_0", "image_1"):
            for path in (second / name).iterdir():
                cv2.imwrite(str(path), np.full((80, 240), 20, np.uint8))
        labels = []
        for sequence in (first, second):
            self.assertEqual(self.make(sequence, model).returncode, 0)
            frame = kysp.read(self.folder / "made" / "priors" / "000001.kysp")
            labels.append(set(frame.cameras[0].segments["label"].tolist()))
        self.assertEqual(labels, [{0, 13}, {0}])

    @unittest.skipUnless(BUILDER, "KYS_BUILD_PRIORS is not set")
    def test_what_the_builder_refuses_is_refused_before_the_network_runs(self):
        sequence = write_sequence(self.folder / "sequence")
        (self.folder / "own.classes.csv").write_text(
            "kys-classes,1,own,2\nid,thing,vector,text,name\n1,0,surrogate,road,road\n"
            "2,1,surrogate,car,car\n")
        model = write_network(self.folder, label_space="own")
        done = self.make(sequence, model)
        self.assertEqual(done.returncode, 2)
        self.assertIn("own.table.csv", done.stderr)
        (self.folder / "own.table.csv").write_text("kys-table,1,own,2\n0,9\n9,0\n")
        for wrong in (["--", "--set", "no.such=1"], ["--", "--nonsense"]):
            done = self.make(sequence, model, *wrong)
            self.assertEqual(done.returncode, 2)
        self.assertFalse((self.folder / "made" / "panoptic").exists())
        done = self.make(sequence, model)
        self.assertEqual(done.returncode, 0, done.stderr)
        frame = kysp.read(self.folder / "made" / "priors" / "000001.kysp")
        self.assertEqual(frame.label_space, "own")

    @unittest.skipUnless(BUILDER, "KYS_BUILD_PRIORS is not set")
    def test_one_component_at_two_depths_becomes_two_instances(self):
        sequence = write_sequence(self.folder / "sequence", columns=(100, 150))
        done = self.make(sequence, write_network(self.folder))
        self.assertEqual(done.returncode, 0, done.stderr)
        ids = cv2.imread(str(self.folder / "made" / "panoptic" / "left" / "000001.png"))
        self.assertEqual(ids[45, 120].tolist(), ids[45, 180].tolist())
        for camera, columns in zip(kysp.read(self.folder / "made" / "priors" / "000001.kysp").cameras,
                                   ((120, 180), (110, 170))):
            parts = [camera.segment_map[45, column] for column in columns]
            self.assertNotEqual(*parts)
            self.assertEqual([camera.segments["label"][k - 1] for k in parts], [13, 13])
            self.assertGreater(min(camera.segments["area"][k - 1] for k in parts), 0.6 * 30 * 42)

    @unittest.skipUnless(BUILDER, "KYS_BUILD_PRIORS is not set")
    def test_from_images_to_prior_files(self):
        sequence, model = write_sequence(self.folder / "sequence"), write_network(self.folder)
        for built in ("3 built, 0 kept", "0 built, 3 kept"):
            done = self.make(sequence, model)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn(built, done.stdout)
        frame = kysp.read(self.folder / "made" / "priors" / "000001.kysp")
        self.assertEqual(frame.label_space, "cityscapes_19")
        self.assertEqual(len(frame.cameras), 2)
        left = frame.cameras[0]
        self.assertEqual(set(left.segments["label"].tolist()), {0, 13})
        self.assertNotEqual(left.segment_map[45, 55], left.segment_map[45, 175])
        for row, column in ((45, 55), (45, 175)):
            segment = left.segments[left.segment_map[row, column] - 1]
            self.assertGreater(segment["area"], 0.7 * 30 * 50)
        times = json.loads((self.folder / "made" / "times.json").read_text())
        self.assertIn("network", times)
        self.assertIn("<figure", (self.folder / "made" / "decisions.html").read_text())
        page = self.folder / "page.html"
        command = [sys.executable, str(ROOT / "tools" / "perception" / "decision_page.py"),
                   str(self.folder / "made" / "priors"), str(sequence), "--output", str(page)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        text = page.read_text()
        self.assertGreaterEqual(text.count("<h2>Object"), 2, "the two boxes")
        self.assertGreaterEqual(text.count("data:image/jpeg;base64,"), 4)
        self.assertIn(" left, car, ", text)
        done = subprocess.run([*command, "--wrong"], capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 2)
        self.assertIn("--wrong needs --truth", done.stderr)

    @unittest.skipUnless((REAL / "espnetv2_cityscapes_384x1248.onnx").exists(),
                         "the real network is not there")
    def test_real_network_finds_the_road(self):
        images = segment_onnx.common.list_images(REAL.parent / "kitti_06_clip" / "image_0")[:1]
        network = segment_onnx.Network(
            ROOT / "tools" / "perception" / "models" / "espnetv2_cityscapes.yaml",
            REAL / "espnetv2_cityscapes_384x1248.onnx")
        segment_onnx.segment_folder(network, images, self.folder / "out")
        document = json.loads((self.folder / "out.json").read_text())
        area = {}
        for segment in document["annotations"][0]["segments_info"]:
            category = segment["category_id"]
            area[category] = area.get(category, 0) + segment["area"]
        size = 1226 * 370
        self.assertGreater(area[7], 0.15 * size, "road")
        self.assertGreater(area[26], 0.005 * size, "cars")

        # The maps of the same network that lie beside it.
        def classes(folder):
            annotations = json.loads(Path(f"{folder}.json").read_text())["annotations"]
            entry = next(a for a in annotations if a["file_name"] == images[0].with_suffix(".png").name)
            ids = cv2.imread(str(folder / entry["file_name"])).astype(np.int64)
            ids = ids[:, :, 2] + 256 * ids[:, :, 1] + 65536 * ids[:, :, 0]
            found = np.zeros(ids.shape, np.int64)
            for segment in entry["segments_info"]:
                found[ids == segment["id"]] = segment["category_id"]
            return found

        ours, theirs = classes(self.folder / "out"), classes(REAL / "kitti_06_city" / "left")
        both = (ours > 0) & (theirs > 0)
        self.assertGreater(np.mean(both), 0.97)
        self.assertGreater(np.mean(ours[both] == theirs[both]), 0.99)


if __name__ == "__main__":
    unittest.main()
