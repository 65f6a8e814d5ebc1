# SPDX-License-Identifier: BSD-3-Clause
"""What the programs around ONNX networks share: the network with its YAML file, its input, threads."""

import concurrent.futures
import json
import os
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import common  # noqa: E402


class OnnxNetwork:
    """An ONNX network and what its YAML file says about it. A subclass reads what it needs of the file
    in _read_settings()."""

    def __init__(self, settings, weights=None):
        import onnxruntime
        import yaml

        self.path = Path(settings)
        with common.reading(settings):
            try:
                self.settings = yaml.safe_load(self.path.read_text(encoding="utf-8"))
            except yaml.YAMLError as error:
                common.fail(f"{settings}: {common.first_line(error)}")
            if not isinstance(self.settings, dict):
                common.fail(f"{settings}: is not a list of settings")
            self._read_settings()
        self.file = Path(weights) if weights else self.path.parent / str(self.settings.get("file", ""))
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1  # several images at a time: the same result for any number
        options.log_severity_level = 4  # errors are raised as well
        try:
            self.session = onnxruntime.InferenceSession(
                str(self.file), options, providers=onnxruntime.get_available_providers())
        except Exception as error:  # onnxruntime has no common base class of its errors
            common.fail(f"{self.file}: cannot be loaded: {common.first_line(error)}")
        self.digest = common.digest_of(self.file)
        self.inputs = [i.name for i in self.session.get_inputs()]
        self.outputs = [o.name for o in self.session.get_outputs()]

    def _read_settings(self):
        """Values of the YAML file; raises whatever a wrong one gives."""
        raise NotImplementedError

    def _read_input(self, channels=3):
        """Size, range and order of the channels (3, or 1 for grey) of the network's images."""
        size, entry = self._get("input", "size"), self.settings["input"]
        if not (isinstance(size, list) and len(size) == 2 and
                all(isinstance(v, int) and 0 < v <= 16384 for v in size)):
            common.fail(f"{self.path}: input.size is '{size}', not [height, width] in px")
        self.height, self.width = size
        self.channels = channels
        self.gamma = self._positive("input.gamma", entry.get("gamma", 1))
        self.divide_by = self._positive("input.divide_by", entry.get("divide_by", 255))
        by_channel = lambda name, default, check: np.array(
            [check(f"input.{name}", v)
             for v in np.broadcast_to(entry.get(name, default), channels).tolist()], np.float32)
        self.mean = by_channel("mean", 0, self._finite)
        self.deviation = by_channel("deviation", 1, self._positive)
        self.bgr = entry.get("colour", "rgb") == "bgr"

    def description(self, **more):
        """What its results depend on beside the images, as text."""
        return json.dumps({"settings": self.settings, "weights": self.digest, **more}, sort_keys=True,
                          default=str)

    def _finite(self, name, value):
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = np.nan
        if not np.isfinite(number):
            common.fail(f"{self.path}: {name} is '{value}', not a number")
        return number

    def _positive(self, name, value):
        number = self._finite(name, value)
        if number <= 0:
            common.fail(f"{self.path}: {name} is {value}, not above 0")
        return number

    def _get(self, *keys):
        value = self.settings
        for key in keys:
            if not isinstance(value, dict) or key not in value:
                common.fail(f"{self.path}: {'.'.join(keys)} is missing")
            value = value[key]
        return value

    def prepare(self, image):
        """(1, channels, h, w) float32 of an (H, W, 3) RGB image."""
        import cv2

        if self.channels == 1:
            image = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        if self.gamma != 1:
            image = (255 * (np.arange(256) / 255) ** self.gamma).astype(np.uint8)[image]
        small = cv2.resize(image, (self.width, self.height), interpolation=cv2.INTER_LINEAR)
        scaled = small.astype(np.float32).reshape(self.height, self.width, self.channels)
        scaled /= self.divide_by
        scaled -= self.mean
        scaled /= self.deviation
        if self.bgr:
            scaled = scaled[:, :, ::-1]
        return np.ascontiguousarray(scaled.transpose(2, 0, 1)[None])

    def _outputs_of(self, tensors, names):
        """Outputs of these names (all for None), by name, for prepared images by name of the input."""
        try:
            values = self.session.run(names, tensors)
        except Exception as error:  # onnxruntime has no common base class of its errors
            common.fail(f"{self.file}: takes no images of {self.width}x{self.height} px (input.size of "
                        f"{self.path}): {common.first_line(error)}")
        return dict(zip(names or self.outputs, values))

    def _check_output(self, key, name):
        """The name of an output as output.KEY gives it; it must be one of the network."""
        if name not in self.outputs:
            common.fail(f"{self.path}: output.{key} is '{name}', the network has "
                        f"{', '.join(self.outputs)}")
        return name


def read_image(path):
    """(H, W, 3) uint8, RGB; grey images are repeated."""
    import cv2

    try:
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    except cv2.error:  # too large
        image = None
    if image is None:
        common.fail(f"{path}: cannot read")
    return np.ascontiguousarray(image[:, :, ::-1])


def in_threads(function, items, label, jobs):
    """[function(item)] for all items, `jobs` at a time, with progress. An error ends all threads."""
    pool = concurrent.futures.ThreadPoolExecutor(jobs)
    try:
        work = [pool.submit(function, item) for item in items]
        return [item.result() for item in common.progress(work, label)]
    finally:
        pool.shutdown(cancel_futures=True)


def add_jobs(parser):
    parser.add_argument("--jobs", type=common.whole(1), default=os.cpu_count() or 1,
                        help="threads (default: all)")
