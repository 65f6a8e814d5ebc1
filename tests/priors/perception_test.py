# SPDX-License-Identifier: BSD-3-Clause
"""The perception adapters, with small randomly initialised networks where torch is installed."""

import io
import json
import os
import struct
import subprocess
import sys
import tempfile
import types
import unittest
import zlib
from pathlib import Path
from unittest import mock

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "priors"))
sys.path.insert(0, str(ROOT / "tools" / "perception"))
sys.path.insert(0, str(ROOT / "python" / "kys_slam"))
import common  # noqa: E402
import decision_page  # noqa: E402
import disparity  # noqa: E402
import evaluate_kitti_06  # noqa: E402
import flow  # noqa: E402
import import_outputs  # noqa: E402
import kysp  # noqa: E402
import panoptic  # noqa: E402
import score_detection  # noqa: E402

try:
    import torch
    from torchvision.models import optical_flow  # noqa: F401
except ImportError:
    torch = None
try:
    import transformers
except ImportError:
    transformers = None
try:
    from PIL import Image
except ImportError:
    Image = None
try:
    import cv2
except ImportError:
    cv2 = None


def make_images(folder, count=2, size=(140, 132)):
    folder.mkdir(parents=True)
    random = np.random.default_rng(1)
    for i in range(count):
        Image.fromarray(random.integers(0, 255, (size[1], size[0], 3), np.uint8)).save(
            folder / f"{i:06d}.png")
    return common.list_images(folder)


class Conversions(unittest.TestCase):
    def test_segments_are_renumbered_and_stuff_is_merged(self):
        source = np.array([[0, 1, 1], [2, 3, 3], [4, -1, 4]])
        info = [{"id": 1, "label_id": 0}, {"id": 2, "label_id": 1}, {"id": 3, "label_id": 1},
                {"id": 4, "label_id": 0}, {"id": 4, "label_id": 1}]
        ids, segments = panoptic.to_coco(source, info, {0: (3, True), 1: (149, False)})
        self.assertEqual([s["category_id"] for s in segments], [3, 149, 3])
        np.testing.assert_array_equal(ids, [[0, 1, 1], [2, 2, 2], [3, 0, 3]])
        self.assertEqual([s["area"] for s in segments], [2, 3, 2])

    def test_nothing_found(self):
        ids, segments = panoptic.to_coco(np.full((2, 2), -1.0), [], {})
        self.assertEqual((int(ids.max()), segments), (0, []))

    def test_label_space(self):
        space = panoptic.read_label_space("coco_panoptic_133")
        self.assertEqual(len(space), 133)
        self.assertEqual(space["car"], (3, True))

    def test_disparity_from_flow(self):
        field = np.zeros((1, 3, 2), np.float32)
        field[0, :, 0] = [-5, 5, -5]
        field[0, 2, 1] = 3
        np.testing.assert_array_equal(disparity.to_disparity(field, -1), [[5, 0, 0]])

    def test_files(self):
        with tempfile.TemporaryDirectory() as folder:
            field = np.arange(24, dtype=np.float32).reshape(3, 4, 2)
            common.write_flo(os.path.join(folder, "a.flo"), field)
            self.assertEqual(os.path.getsize(os.path.join(folder, "a.flo")), 12 + 96)
            common.write_pfm(os.path.join(folder, "a.pfm"), field[..., 0])
            data = Path(folder, "a.pfm").read_bytes()
            self.assertTrue(data.startswith(b"Pf\n4 3\n-1.0\n"))
            self.assertEqual(np.frombuffer(data[-48:], "<f4")[0], field[2, 0, 0])


    @unittest.skipUnless(Image, "Pillow is not installed")
    def test_damaged_images(self):
        with tempfile.TemporaryDirectory() as folder:
            path = make_images(Path(folder, "images"), 1)[0]
            whole = path.read_bytes()
            header = bytearray(whole)
            header[16:24] = b"\x00\x10\x00\x00" * 2  # sides of 2^20 px: Pillow fears a bomb
            struct.pack_into(">I", header, 29, zlib.crc32(header[12:29]))
            for data in (b"", b"x", whole[:-40], whole[:60], whole[:33] + b"\xff" * 20, bytes(header)):
                path.write_bytes(data)
                with self.assertRaisesRegex(common.InputError, "000000.png: cannot read"):
                    common.read_rgb(path)


@unittest.skipUnless(Image, "Pillow is not installed")
class Kept(unittest.TestCase):
    """Outputs are kept if they are of the same images, network and settings; without a real network."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.files = make_images(self.folder / "images", 3)
        self.model = self.network(0)

    @staticmethod
    def network(weight):
        weights = mock.Mock()
        weights.detach().cpu().float().numpy.return_value = np.float32([weight])
        model = mock.Mock(state_dict=lambda: {"layer": weights})
        model.config.id2label = {0: "road"}
        return model

    def check(self, made, process):
        """`process` makes the outputs of three images; `made` counts by what is estimated."""
        counts = []

        def run(settings):
            before = made.call_count
            process(settings)
            counts.append(made.call_count - before)

        run(1)
        run(1)
        Image.new("RGB", (140, 132)).save(self.files[2])
        run(1)
        self.model = self.network(1)
        run(1)
        run(2)
        run(2)
        return counts

    def test_flow(self):
        with mock.patch.object(flow, "estimate", return_value=np.zeros((132, 140, 2))) as made:
            counts = self.check(made, lambda settings: flow.process(
                self.files, self.folder / "flow", self.folder / "back", self.model, "cpu", settings))
        self.assertEqual(counts, [4, 0, 2, 4, 4, 0])

    def test_disparity(self):
        right = make_images(self.folder / "right", 3)
        with mock.patch.object(flow, "estimate", return_value=np.zeros((132, 140, 2))) as made:
            counts = self.check(made, lambda settings: disparity.process(
                self.files, right, self.folder / "disparity", None, self.model, "cpu", settings))
            self.assertEqual(counts, [3, 0, 1, 3, 3, 0])
            Image.new("RGB", (140, 132)).save(right[0])
            made.reset_mock()
            disparity.process(self.files, right, self.folder / "disparity", None, self.model, "cpu", 2)
            self.assertEqual(made.call_count, 1)

    def test_maps(self):
        found = np.ones((132, 140), int), [{"id": 1, "label_id": 0}]
        with mock.patch.object(panoptic, "run_panoptic", return_value=found) as made:
            counts = self.check(made, lambda settings: panoptic.process(
                self.files, self.folder / "maps", self.model, "processor", {"road": (7, False)}, "cpu",
                threshold=settings))
        self.assertEqual(counts, [3, 0, 1, 3, 3, 0])
        document = json.loads((self.folder / "maps.json").read_text())
        self.assertEqual([a["segments_info"][0]["category_id"] for a in document["annotations"]], [7] * 3)


class Kitti06(unittest.TestCase):
    def test_the_car_is_where_it_is_seen(self):
        """Frame 22: columns 452 to 475 by eye, half behind a tree; before that it is too small."""
        def is_the_car(number, first, last):
            frame = mock.Mock(cameras=[mock.Mock(segments=np.zeros(1, kysp.SEGMENT),
                                                 segment_map=np.zeros((1, 1226), np.uint16))])
            frame.cameras[0].segment_map[0, first:last + 1] = 1
            row = {"frame": f"{number:06d}", "camera": "left", "identity": 0, "mean_depth_m": 80.0}
            return evaluate_kitti_06.is_the_car(row, frame)

        self.assertTrue(is_the_car(22, 452, 475))
        self.assertFalse(is_the_car(22, 480, 500))
        self.assertFalse(is_the_car(21, 452, 500))
        self.assertFalse(is_the_car(50, 0, 500))


class ImportedOutputs(unittest.TestCase):
    """Outputs of networks that ran elsewhere, under the names build_priors looks for."""

    def run_import(self, *arguments):
        with mock.patch.object(sys, "argv", ["import_outputs.py", *map(str, arguments)]):
            import_outputs.main()

    def test_unimatch(self):
        with tempfile.TemporaryDirectory() as folder:
            made, out = Path(folder, "made"), Path(folder, "out")
            made.mkdir()
            (made / "000007_flow.png").write_bytes(b"a picture")
            common.write_flo(made / "000007_pred.flo", np.full((3, 4, 2), 1.5))
            common.write_flo(made / "000007_pred_bwd.flo", np.full((3, 4, 2), -1.5))
            common.write_pfm(made / "000007_disp.pfm", np.full((3, 4), 8.0))
            common.write_pfm(made / "000007_disp_right.pfm", np.full((3, 4), 9.0))
            self.run_import("unimatch-flow", made, "--output", out / "flow", "--backward", out / "back",
                            "--images", Path(folder, "image_2"))
            self.run_import("unimatch-disparity", made, "--output", out / "disparity", "--right",
                            out / "disparity_right", "--images", Path(folder, "image_2"))
            for name, source in (("flow/000007.flo", "pred.flo"), ("back/000007.flo", "pred_bwd.flo"),
                                 ("disparity/000007.pfm", "disp.pfm"),
                                 ("disparity_right/000007.pfm", "disp_right.pfm")):
                self.assertEqual((out / name).read_bytes(), (made / f"000007_{source}").read_bytes())
            for name, images in (("flow", "image_2"), ("back", "image_2"), ("disparity", "image_2"),
                                 ("disparity_right", "image_3")):
                self.assertEqual((out / name / "images.txt").read_text(), images + "\n")
            with self.assertRaisesRegex(common.InputError, "holds no"):
                self.run_import("unimatch-flow", out / "disparity", "--output", out / "x")

    def test_kmax(self):
        with tempfile.TemporaryDirectory() as folder:
            made, out = Path(folder, "made"), Path(folder, "out") / "left"
            made.mkdir()
            (made / "000007.png").write_bytes(b"segments")
            document = Path(folder, "predictions.json")
            infos = [{"id": 5, "category_id": 3, "isthing": True}]
            document.write_text(json.dumps({"annotations": [
                {"image_id": 7, "file_name": "000007.png", "segments_info": infos}]}))
            self.run_import("kmax", made, "--json", document, "--output", out)
            self.assertEqual((out / "000007.png").read_bytes(), b"segments")
            read = json.loads((out.parent / "left.json").read_text())
            self.assertEqual(read["annotations"], [{"file_name": "000007.png", "segments_info": infos}])
            (made / "000008.png").write_bytes(b"more")
            with self.assertRaisesRegex(common.InputError, "says nothing of 000008"):
                self.run_import("kmax", made, "--json", document, "--output", out)
            document.write_text("[1]")
            with self.assertRaisesRegex(common.InputError, "not the document"):
                self.run_import("kmax", made, "--json", document, "--output", out)


@unittest.skipUnless(Image, "Pillow is not installed")
class DisparityNotes(unittest.TestCase):
    def test_disparities_note_the_images_they_are_of(self):
        with tempfile.TemporaryDirectory() as folder:
            left, right = (make_images(Path(folder, f"image_{i}")) for i in (2, 3))
            with mock.patch.object(common, "digest_of_network", return_value="network"), \
                    mock.patch.object(flow, "estimate", return_value=np.zeros((132, 140, 2))):
                disparity.process(left, right, Path(folder, "d"), Path(folder, "r"), None, None)
            self.assertEqual(Path(folder, "d", "images.txt").read_text(), "image_2\n")
            self.assertEqual(Path(folder, "r", "images.txt").read_text(), "image_3\n")


class Decisions(unittest.TestCase):
    """Pages and scores of the decisions of three frames; the last one has nothing in it."""

    SHAPE = (40, 60)
    SEGMENTS = [*decision_page.COLUMNS, "magnitude_test", "radial_test", "residual_px", "radial_px",
                "coverage", "omega"]

    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)
        self.priors = self.folder / "priors"
        self.priors.mkdir()

    def write_priors(self, shares):
        rows = []
        for t in range(3):
            cameras = []
            for side in range(2):
                identity = 70000 + side * kysp.RIGHT_INSTANCES
                where = np.zeros(self.SHAPE, np.uint16)
                segments = np.zeros(1 if t < 2 else 0, kysp.SEGMENT)
                if t < 2:
                    where[10:30, 20:40] = 1
                    segments[0] = (2, kysp.THING, identity, 0, 0, 400)
                    values = dict.fromkeys(self.SEGMENTS, "0")
                    values.update(frame=f"{t:06d}", camera=("left", "right")[side], input_id="5",
                                  identity=identity, label="2", area_px="400", state="static")
                    rows.append(",".join(str(values[c]) for c in self.SEGMENTS))
                cameras.append(kysp.Camera(segments, where))
            frame = kysp.Frame("coco_panoptic_133", cameras, shares_instances=shares)
            (self.priors / f"{t:06d}.kysp").write_bytes(kysp.encode(frame))
        (self.priors / "segments.csv").write_text("\n".join([",".join(self.SEGMENTS), *rows]) + "\n")

    def page(self):
        output = self.folder / "page.html"
        with mock.patch.object(sys, "argv", ["decision_page.py", str(self.priors), str(self.folder),
                                             "--output", str(output)]):
            decision_page.main()
        return output.read_text()

    @unittest.skipUnless(cv2, "OpenCV is not installed")
    def test_page(self):
        for side in range(2):
            folder = self.folder / f"image_{side}"
            folder.mkdir()
            for t in range(3):
                cv2.imwrite(str(folder / f"{t:06d}.jpg"), np.full((*self.SHAPE, 3), 90, np.uint8))
        for shares, objects in ((True, 1), (False, 2)):
            self.write_priors(shares)
            page = self.page()
            self.assertEqual(page.count("<h2>Object"), objects)
            self.assertEqual(page.count("data:image/jpeg"), 4, "both frames with a thing, both cameras")
            self.assertIn("frame 000001 left", page)
        (self.folder / "image_1" / "000001.jpg").unlink()
        with self.assertRaisesRegex(common.InputError, "image_1: has no image 000001"):
            self.page()

    def test_score_leaves_out_the_last_frame_of_the_files(self):
        self.write_priors(True)
        truth = self.folder / "truth.csv"
        truth.write_text("frame,camera,segment_id,moving\n0,left,5,1\n1,left,5,1\n")
        arguments = ["score_detection.py", self.priors, truth, "--camera", "left"]
        with mock.patch.object(sys, "argv", [*map(str, arguments)]), \
                mock.patch("sys.stdout", new_callable=io.StringIO) as said:
            score_detection.main()
        self.assertIn("recall    0.000 (2 moving)", said.getvalue())
        (self.priors / "000002.kysp").unlink()
        with mock.patch.object(sys, "argv", [*map(str, arguments)]), \
                mock.patch("sys.stdout", new_callable=io.StringIO) as said:
            score_detection.main()
        self.assertIn("recall    0.000 (1 moving)", said.getvalue())


@unittest.skipUnless(torch and Image, "torch, torchvision or Pillow is not installed")
class Raft(unittest.TestCase):
    def test_flow_and_disparity(self):
        with tempfile.TemporaryDirectory() as folder:
            files = make_images(Path(folder, "images"))
            model = flow.load_raft("raft_small", "none", torch.device("cpu"))
            flow.process(files, Path(folder, "flow"), Path(folder, "back"), model,
                         torch.device("cpu"), 2)
            disparity.process(files, files, Path(folder, "d"), None, model, torch.device("cpu"), 2)
            self.assertEqual(Path(folder, "flow", "000000.flo").stat().st_size,
                             12 + 8 * 140 * 132)
            self.assertTrue(Path(folder, "back", "000000.flo").exists())
            self.assertTrue(Path(folder, "d", "000001.pfm").exists())


def tiny_mask2former(names, image):
    """A Mask2Former of a few thousand random weights that finds something in `image`, and its
    processor."""
    from transformers import (Mask2FormerConfig, Mask2FormerForUniversalSegmentation,
                              Mask2FormerImageProcessor, SwinConfig)

    backbone = SwinConfig(embed_dim=8, depths=[1, 1, 1, 1], num_heads=[1, 1, 1, 1],
                          out_features=["stage1", "stage2", "stage3", "stage4"])
    config = Mask2FormerConfig(backbone_config=backbone, hidden_dim=32, feature_size=32,
                               mask_feature_size=32, num_attention_heads=2, encoder_layers=1,
                               decoder_layers=2, num_queries=5, dim_feedforward=16,
                               encoder_feedforward_dim=16, id2label=dict(enumerate(names)))
    processor = Mask2FormerImageProcessor(size={"height": 64, "width": 64})
    for seed in range(20):
        torch.manual_seed(seed)
        model = Mask2FormerForUniversalSegmentation(config).eval()
        with torch.no_grad():  # decided scores and masks, hardly ever "no object"
            model.class_predictor.weight.normal_(0, 3)
            model.class_predictor.bias[-1] = -20
            for name, weights in model.named_parameters():
                if "mask_embedder" in name and weights.dim() == 2:
                    weights.normal_(0, 1)
            model.model.transformer_module.queries_features.weight.normal_(0, 3)
        if panoptic.run_panoptic(image, model, processor, torch.device("cpu"), 0.0)[1]:
            return model, processor
    raise AssertionError("none of the networks finds anything")


def run_main(module, *arguments):
    """An adapter as from the command line; its message or status, None when it ran to its end."""
    with mock.patch.object(sys, "argv", [module.__name__, *map(str, arguments)]):
        try:
            module.main()
        except common.InputError as error:
            return str(error)
        except SystemExit as end:
            return end.code
    return None


@unittest.skipUnless(torch and transformers and Image, "torch or transformers is not installed")
class Mask2Former(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        image = np.random.default_rng(1).integers(0, 255, (132, 140, 3), np.uint8)
        cls.model, cls.processor = tiny_mask2former(["person", "road", "car"], image)

    def setUp(self):
        self.space = panoptic.read_label_space("coco_panoptic_133")
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.files = make_images(self.folder / "images")

    def process(self, name, **options):
        panoptic.process(self.files, self.folder / name, self.model, self.processor, self.space,
                         torch.device("cpu"), **options)

    def test_panoptic_is_coco(self):
        self.process("left", threshold=0.0)
        document = json.loads((self.folder / "left.json").read_text())
        self.assertEqual(len(document["categories"]), 133)
        self.assertEqual(len(document["annotations"]), 2)
        found = 0
        for annotation in document["annotations"]:
            rgb = np.asarray(Image.open(self.folder / "left" / annotation["file_name"]), np.uint32)
            self.assertEqual(rgb.shape, (132, 140, 3))
            ids = rgb[..., 0] + 256 * rgb[..., 1] + 65536 * rgb[..., 2]
            segments = annotation["segments_info"]
            self.assertEqual(set(np.unique(ids)) - {0}, {s["id"] for s in segments})
            for segment in segments:
                self.assertIn(segment["category_id"], (1, 3, 149))
                self.assertEqual(segment["area"], int((ids == segment["id"]).sum()))
            found += len(segments)
        self.assertGreater(found, 0)

    def test_nothing_is_found(self):
        self.process("left", threshold=1.1)
        document = json.loads((self.folder / "left.json").read_text())
        self.assertEqual([a["segments_info"] for a in document["annotations"]], [[], []])

    def test_what_is_there_is_kept(self):
        self.process("left", threshold=0.0)
        first = (self.folder / "left" / "000000.png").read_bytes()
        (self.folder / "left" / "000001.png").unlink()
        with mock.patch.object(panoptic, "run_panoptic", wraps=panoptic.run_panoptic) as run:
            self.process("left", threshold=0.0)
        self.assertEqual(run.call_count, 1)
        self.assertEqual((self.folder / "left" / "000000.png").read_bytes(), first)
        self.assertTrue((self.folder / "left" / "000001.png").exists())

    def test_semantic(self):
        self.process("semantic", task="semantic")
        labels = np.asarray(Image.open(self.folder / "semantic" / "000000.png"))
        self.assertEqual((labels.shape, labels.dtype), ((132, 140), np.uint8))
        self.assertTrue(set(np.unique(labels)) <= {1, 3, 149})

    def test_a_model_that_cannot_be_loaded(self):
        with mock.patch.dict(os.environ, HF_HUB_OFFLINE="1"):
            said = run_main(panoptic, self.folder / "images", "--output", self.folder / "out",
                            "--model", self.folder / "nowhere")
        self.assertIn("nowhere: cannot load: ", said)
        self.assertEqual(len(said.splitlines()), 1)


@unittest.skipUnless(torch and transformers and Image, "torch or transformers is not installed")
@unittest.skipUnless("KYS_BUILD_PRIORS" in os.environ, "ctest says where build_priors is")
class EndToEnd(unittest.TestCase):
    """Networks saved to disk, the adapters' command lines, and build_priors on what they wrote."""

    FRAMES = 3

    def make_sequence(self, folder):
        for camera in (2, 3):
            make_images(folder / f"image_{camera}", self.FRAMES)
        row = "100 0 70 {} 0 100 66 0 0 0 1 0\n"
        (folder / "calib.txt").write_text("P2: " + row.format(0) + "P3: " + row.format(-50))
        (folder / "times.txt").write_text("".join(f"{0.1 * i}\n" for i in range(self.FRAMES)))

    def save_networks(self, folder):
        image = common.read_rgb(folder / "sequence" / "image_2" / "000000.png")
        for part in tiny_mask2former(panoptic.read_label_space("coco_panoptic_133"), image):
            part.save_pretrained(folder / "mask2former")
        torch.manual_seed(0)
        torch.save(flow.load_raft("raft_small", "none", torch.device("cpu")).state_dict(),
                   folder / "raft.pth")

    def test_build_priors_reads_it(self):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            sequence, out = folder / "sequence", folder / "out"
            self.make_sequence(sequence)
            self.save_networks(folder)
            raft = ["--model", "raft_small", "--weights", folder / "raft.pth", "--iterations", 2]
            for side, camera in (("left", 2), ("right", 3)):
                images = sequence / f"image_{camera}"
                self.assertIsNone(run_main(panoptic, images, "--output", out / "panoptic" / side,
                                           "--model", folder / "mask2former", "--threshold", 0))
                self.assertIsNone(run_main(flow, images, "--output", out / "flow" / side,
                                           "--backward", out / "back" / side, *raft))
            self.assertIsNone(run_main(disparity, sequence / "image_2", sequence / "image_3",
                                       "--output", out / "disparity", "--right",
                                       out / "disparity_right", *raft))
            done = subprocess.run(
                [os.environ["KYS_BUILD_PRIORS"], sequence, "--quiet", "--output", out / "priors",
                 "--panoptic-left", out / "panoptic" / "left",
                 "--panoptic-right", out / "panoptic" / "right",
                 "--disparity", out / "disparity", "--disparity-right", out / "disparity_right",
                 "--flow-left", out / "flow" / "left", "--flow-right", out / "flow" / "right",
                 "--flow-back-left", out / "back" / "left",
                 "--flow-back-right", out / "back" / "right"], capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stderr)
            files = sorted(f.name for f in (out / "priors").glob("*.kysp"))
            self.assertEqual(files, [f"{i:06d}.kysp" for i in range(self.FRAMES)])
            first = kysp.read(out / "priors" / files[0])
            self.assertEqual(first.cameras[0].segment_map.shape, (132, 140))
            self.assertGreater(len(first.cameras[0].segments), 0)


@unittest.skipUnless(torch and Image, "torch, torchvision or Pillow is not installed")
class Refusals(unittest.TestCase):
    def test_weights_that_are_none(self):
        with tempfile.TemporaryDirectory() as folder:
            make_images(Path(folder, "images"))
            weights = Path(folder, "weights.pth")
            weights.write_bytes(b"not a network")
            said = run_main(flow, Path(folder, "images"), "--output", Path(folder, "flow"),
                            "--model", "raft_small", "--weights", weights)
            self.assertIn("weights.pth of raft_small: cannot load: ", said)

    def test_device_that_is_none(self):
        with self.assertRaises(common.InputError) as end:
            common.choose_device("warp")
        self.assertTrue(str(end.exception).startswith("--device warp: "))


class ModelClasses(unittest.TestCase):
    """How a model's class names find the label space's."""

    @staticmethod
    def categories(names, space):
        config = types.SimpleNamespace(id2label={str(i): n for i, n in enumerate(names)})
        return panoptic.categories_of(types.SimpleNamespace(config=config), space)

    def test_by_name(self):
        space = panoptic.read_label_space("coco_panoptic_133")
        self.assertEqual(self.categories(["road", "car"], space), {0: (149, False), 1: (3, True)})

    def test_synonyms_by_place(self):
        space = panoptic.read_label_space("ade20k_150")
        names = list(space)
        # As the hub's ADE20K models spell them.
        for name, other in (("bed", "bed "), ("window", "windowpane"), ("tub", "bathtub"),
                            ("street lamp", "streetlight"), ("road", "road, route")):
            names[names.index(name)] = other
        found = self.categories(names, space)
        self.assertEqual([found[i] for i in range(150)], list(space.values()))

    def test_unknown_class(self):
        space = panoptic.read_label_space("ade20k_150")
        shuffled = list(space)[1:] + ["windowpane"]
        for names in (["road", "starship"], shuffled):
            with self.assertRaises(common.InputError) as end:
                self.categories(names, space)
            self.assertIn(names[-1], str(end.exception))


if __name__ == "__main__":
    unittest.main()
