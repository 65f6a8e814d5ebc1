# SPDX-License-Identifier: BSD-3-Clause
"""What tests of ONNX networks share: tiny networks, a stereo sequence, make_priors. MISSING says which
of onnxruntime, onnx, cv2 and yaml is not installed."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "perception"))
sys.path.insert(0, str(ROOT / "python" / "kys_slam"))

MISSING = ""
try:
    import cv2
    import onnx
    import onnxruntime  # noqa: F401
    import yaml
except ImportError as error:
    cv2 = onnx = yaml = None
    MISSING = str(error)

BUILDER = os.environ.get("KYS_BUILD_PRIORS")
SETTINGS = {
    "file": "tiny.onnx",
    "input": {"size": [40, 120], "divide_by": 255},
    "output": {"kind": "semantic"},
    "label_space": "cityscapes_19",
    "classes": ["road", "car"],
}


def write_graph(path, nodes, inputs, outputs, constants):
    """An ONNX file. Inputs and outputs: float tensors, {name: shape}."""
    tensors = [[onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, shape)
                for name, shape in some.items()] for some in (inputs, outputs)]
    graph = onnx.helper.make_graph(nodes, "tiny", *tensors, constants)
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 13)],
                                   ir_version=8)
    path.write_bytes(model.SerializeToString())


def write_network(folder, scale=1.0, **changes):
    """Logits (-r, r - 0.5) of the red channel r: bright is car, dark is road."""
    node = onnx.helper.make_node("Conv", ["image", "weights", "bias"], ["logits"])
    weights = np.zeros((2, 3, 1, 1), np.float32)
    weights[:, 0, 0, 0] = -scale, scale
    constants = [onnx.numpy_helper.from_array(weights, "weights"),
                 onnx.numpy_helper.from_array(np.array([0.5, -0.5], np.float32), "bias")]
    write_graph(folder / "tiny.onnx", [node], {"image": [1, 3, 40, 120]}, {"logits": [1, 2, 40, 120]},
                constants)
    (folder / "tiny.yaml").write_text(yaml.safe_dump({**SETTINGS, **changes}))
    return folder / "tiny.yaml"


def write_sequence(folder, frames=3, columns=(30, 150)):
    """A textured dark wall at 4 px of disparity, and two bright boxes nearer by, at these columns."""
    random = np.random.default_rng(3)
    wall = random.integers(0, 100, (80, 300)).astype(np.uint8)
    boxes = random.integers(160, 255, (80, 300)).astype(np.uint8)
    for name, shift in (("image_0", 0), ("image_1", 1)):
        (folder / name).mkdir(parents=True)
        for t in range(frames):
            image = wall[:, 20 + 4 * shift:260 + 4 * shift].copy()
            for x, disparity in zip(columns, (8, 14)):
                x0 = x - disparity * shift
                image[30:60, x0:x0 + 50] = boxes[30:60, x:x + 50]
            cv2.imwrite(str(folder / name / f"{t:06d}.png"), image)
    row = "100 0 120 {} 0 100 40 0 0 0 1 0"
    (folder / "calib.txt").write_text(f"P0: {row.format(0)}\nP1: {row.format(-50)}\n")
    (folder / "times.txt").write_text("".join(f"{0.1 * t}\n" for t in range(frames)))
    return folder


def make_priors(sequence, model, output, *more):
    """The finished process of make_priors.py."""
    return subprocess.run(
        [sys.executable, str(ROOT / "tools" / "perception" / "make_priors.py"), str(sequence),
         "--model", str(model), "--builder", BUILDER, "--output", str(output), *map(str, more)],
        capture_output=True, text=True, check=False)
