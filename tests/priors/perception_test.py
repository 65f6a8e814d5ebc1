"""The perception adapters, with small randomly initialised networks where torch is installed."""

import json
import os
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "perception"))
import common  # noqa: E402
import disparity  # noqa: E402
import flow  # noqa: E402
import panoptic  # noqa: E402

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


@unittest.skipUnless(torch and transformers and Image, "torch or transformers is not installed")
class Mask2Former(unittest.TestCase):
    def test_panoptic_and_semantic(self):
        from transformers import (Mask2FormerConfig, Mask2FormerForUniversalSegmentation,
                                  Mask2FormerImageProcessor, SwinConfig)

        backbone = SwinConfig(embed_dim=8, depths=[1, 1, 1, 1], num_heads=[1, 1, 1, 1],
                              out_features=["stage1", "stage2", "stage3", "stage4"])
        config = Mask2FormerConfig(backbone_config=backbone, hidden_dim=16, feature_size=16,
                                   mask_feature_size=16, num_attention_heads=2, encoder_layers=1,
                                   decoder_layers=2, num_queries=5, dim_feedforward=16,
                                   encoder_feedforward_dim=16,
                                   id2label={0: "person", 1: "road", 2: "car"})
        torch.manual_seed(0)
        model = Mask2FormerForUniversalSegmentation(config)
        processor = Mask2FormerImageProcessor(size={"height": 64, "width": 64})
        space = panoptic.read_label_space("coco_panoptic_133")
        with tempfile.TemporaryDirectory() as folder:
            files = make_images(Path(folder, "images"))
            panoptic.process(files, Path(folder, "left"), model, processor, space,
                             torch.device("cpu"), threshold=0.0)
            document = json.loads(Path(folder, "left.json").read_text())
            self.assertEqual(len(document["annotations"]), 2)
            panoptic.process(files, Path(folder, "semantic"), model, processor, space,
                             torch.device("cpu"), task="semantic")
            labels = np.asarray(Image.open(Path(folder, "semantic", "000000.png")))
            self.assertEqual(labels.shape, (132, 140))
            self.assertTrue(set(np.unique(labels)) <= {1, 3, 149})


if __name__ == "__main__":
    unittest.main()
