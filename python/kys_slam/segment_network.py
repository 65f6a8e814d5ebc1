# SPDX-License-Identifier: BSD-3-Clause
"""Segmentation networks as ONNX files, by ONNX Runtime. A YAML file says what the network wants and gives
(docs/guide.md, "Networks beside the tracker"). Without the rest of the package: tools/perception uses it
too.

    network = SegmentNetwork("network.yaml")
    ids, segments = network.segment(image)   # (H, W, 3) uint8, RGB

Needs onnxruntime, PyYAML and OpenCV.
"""

import contextlib
import hashlib
import json
from pathlib import Path

import numpy as np

MIN_PIXELS = 150       # of an instance found by connected components
MAPS_VERSION = 2       # raised when the same images give other maps
KINDS = ("semantic", "classes", "panoptic", "instances")
# What reading a damaged file may raise.
BAD_CONTENT = (KeyError, ValueError, TypeError, IndexError, AttributeError, ArithmeticError, RecursionError)


class NetworkError(ValueError):
    """A network, or its YAML file, that cannot be used; the message is one line that names the file."""


def first_line(error):
    """The first line of an exception's message, or its type."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def need():
    """NetworkError when a package is not installed."""
    for module, package in (("onnxruntime", "onnxruntime"), ("yaml", "pyyaml"),
                            ("cv2", "opencv-python-headless")):
        try:
            __import__(module)
        except ImportError:
            raise NetworkError(f"networks need {package}: pip install {package}") from None


class OnnxNetwork:
    """An ONNX network and what its YAML file says about it. A subclass reads what it needs of the file
    in _read_settings()."""

    _errors = (NetworkError,)  # that fail() raises

    def __init__(self, settings, weights=None, threads=1):
        """threads: of one image. Results may differ by rounding with their number."""
        import onnxruntime
        import yaml

        self.path = Path(settings)
        with self._reading(settings):
            try:
                self.settings = yaml.safe_load(self.path.read_text(encoding="utf-8"))
            except yaml.YAMLError as error:
                self.fail(f"{settings}: {first_line(error)}")
            if not isinstance(self.settings, dict):
                self.fail(f"{settings}: is not a list of settings")
            self._read_settings()
        self.file = Path(weights) if weights else self.path.parent / str(self.settings.get("file", ""))
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.log_severity_level = 4  # errors are raised as well
        try:
            self.session = onnxruntime.InferenceSession(
                str(self.file), options, providers=onnxruntime.get_available_providers())
        except Exception as error:  # onnxruntime has no common base class of its errors
            self.fail(f"{self.file}: cannot be loaded: {first_line(error)}")
        self.digest = self._digest()
        self.inputs = [i.name for i in self.session.get_inputs()]
        self.outputs = [o.name for o in self.session.get_outputs()]

    @staticmethod
    def fail(message):
        """The network or its file is at fault."""
        raise NetworkError(message)

    @contextlib.contextmanager
    def _reading(self, path):
        """What is wrong with a file's content as an error that names the file."""
        try:
            yield
        except OSError as error:
            self.fail(f"{path}: {error.strerror or error}")
        except KeyError as error:
            self.fail(f"{path}: {error} is missing")
        except BAD_CONTENT as error:
            if isinstance(error, self._errors):
                raise
            self.fail(f"{path}: {first_line(error)}")

    def _digest(self):
        """SHA-256 of the ONNX file and its length."""
        with self._reading(self.file):
            data = self.file.read_bytes()
        return hashlib.sha256(len(data).to_bytes(8, "little") + data).hexdigest()

    def _read_settings(self):
        """Values of the YAML file; raises whatever a wrong one gives."""
        raise NotImplementedError

    def _read_input(self, channels=3):
        """Size, range and order of the channels (3, or 1 for grey) of the network's images."""
        size, entry = self._get("input", "size"), self.settings["input"]
        if not (isinstance(size, list) and len(size) == 2 and
                all(isinstance(v, int) and 0 < v <= 16384 for v in size)):
            self.fail(f"{self.path}: input.size is '{size}', not [height, width] in px")
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
            self.fail(f"{self.path}: {name} is '{value}', not a number")
        return number

    def _positive(self, name, value):
        number = self._finite(name, value)
        if number <= 0:
            self.fail(f"{self.path}: {name} is {value}, not above 0")
        return number

    def _get(self, *keys):
        value = self.settings
        for key in keys:
            if not isinstance(value, dict) or key not in value:
                self.fail(f"{self.path}: {'.'.join(keys)} is missing")
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
            self.fail(f"{self.file}: takes no images of {self.width}x{self.height} px (input.size of "
                        f"{self.path}): {first_line(error)}")
        return dict(zip(names or self.outputs, values))

    def _check_output(self, key, name):
        """The name of an output as output.KEY gives it; it must be one of the network."""
        if name not in self.outputs:
            self.fail(f"{self.path}: output.{key} is '{name}', the network has "
                        f"{', '.join(self.outputs)}")
        return name


class SegmentNetwork(OnnxNetwork):
    """An ONNX network for segmentation and what its YAML file says about it."""

    def __init__(self, settings, weights=None, threshold=None, threads=1):
        self.threshold = threshold
        super().__init__(settings, weights, threads)
        self.input = self.inputs[0]

    def _read_settings(self):
        self.kind = self._get("output", "kind")
        if self.kind not in KINDS:
            self.fail(f"{self.path}: output.kind is '{self.kind}', not one of {', '.join(KINDS)}")
        default = 0.5 if self.kind == "instances" else 0.0
        given = self.settings["output"].get("min_score", default)
        self.threshold = self._finite("output.min_score",
                                      given if self.threshold is None else self.threshold)
        self.divisor = self._positive("output.divisor", self.settings["output"].get("divisor", 256))
        self._read_input()
        space_name = self._get("label_space")
        self.label_space = self._beside(space_name)
        space = self._read_space(self.label_space)
        self.classes = []
        for name in self._get("classes"):
            if name is not None and name not in space:
                self.fail(f"{self.path}: class '{name}' is not in label space {space_name}")
            self.classes.append(None if name is None else (name, *space[name]))

    @staticmethod
    def _read_space(name):
        """{class name: (id of the data set, thing)} of a label space."""
        from kys_slam import InputError, LabelSpace
        try:
            space = LabelSpace(str(name))
        except InputError as error:
            raise NetworkError(str(error)) from None
        return {n: (i, t) for n, i, t in zip(space.names, space.ids, space.things)}

    def description(self):
        """What its maps depend on beside the images."""
        return super().description(version=MAPS_VERSION, threshold=self.threshold, classes=self.classes)

    def _beside(self, name):
        """A label space as the programs take it: the path of its files without their endings where they
        are beside the YAML file, else its name."""
        beside = self.path.resolve().parent / str(name)
        return str(beside) if beside.with_name(f"{beside.name}.classes.csv").exists() else name

    def run(self, image):
        """Outputs of the network by name."""
        return self._outputs_of({self.input: self.prepare(image)}, None)

    def output(self, values, key):
        name = self.settings["output"].get(key)
        if name is None and len(values) == 1:
            return next(iter(values.values()))
        return values[self._check_output(key, name)]

    def segment(self, image):
        """Ids (H, W) with 0 void, and segments_info of COCO, of an (H, W, 3) uint8 RGB image."""
        return to_panoptic(self, self.run(image), image.shape[:2])


def resized(labels, size):
    """An (h, w) integer map at (height, width), nearest neighbour."""
    import cv2

    return cv2.resize(labels.astype(np.float32), size[::-1], interpolation=cv2.INTER_NEAREST).astype(
        np.int64)


def without_weak_things(network, logits, labels):
    """Where a thing's probability (softmax) is below the threshold, the best other class counts."""
    things = [k for k, entry in enumerate(network.classes) if entry is not None and entry[2]]
    largest = np.max(logits, axis=0)
    probability = 1 / np.sum(np.exp(logits - largest), axis=0)  # of the best class
    weak = np.isin(labels, things) & (probability < network.threshold)
    others = logits.copy()
    others[things] = -np.inf
    return np.where(weak, np.argmax(others, axis=0), labels)


def class_map(network, values, size):
    """(H, W) index into the network's classes, -1 void, of kinds semantic and classes."""
    import cv2

    found = network.output(values, "name")
    found = found[0] if found.ndim == 4 or (found.ndim == 3 and network.kind == "classes") else found
    if network.kind == "classes":
        labels = resized(np.squeeze(found), size)
    else:
        if found.ndim != 3 or found.shape[0] < len(network.classes):
            network.fail(f"{network.path}: the network gives {found.shape}, not "
                        f"{len(network.classes)} classes by height by width")
        # Logits, not labels, are enlarged: edges stay smooth.
        big = [cv2.resize(np.ascontiguousarray(plane, np.float32), size[::-1],
                          interpolation=cv2.INTER_LINEAR) for plane in found]
        labels = np.argmax(big, axis=0)
        if network.threshold > 0:
            labels = without_weak_things(network, np.asarray(big), labels)
    labels[(labels < 0) | (labels >= len(network.classes))] = -1
    return labels


def components(mask):
    """Connected components (label image, 0 none) of at least MIN_PIXELS."""
    import cv2

    count, parts, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    large = stats[:, cv2.CC_STAT_AREA] >= MIN_PIXELS
    large[0] = False
    return np.where(large, np.arange(count), 0)[parts]


def to_panoptic(network, values, size):
    """Ids (H, W) with 0 void, and segments_info of COCO."""
    ids = np.zeros(size, np.uint32)
    segments = []

    def add(mask, entry):
        if not mask.any():
            return
        number = len(segments) + 1
        ids[mask] = number
        segments.append({"id": number, "category_id": entry[1], "isthing": int(entry[2])})

    if network.kind == "instances":
        masks = np.squeeze(network.output(values, "masks"))
        labels = np.ravel(network.output(values, "labels")).astype(int)
        scores = np.ravel(network.output(values, "scores"))
        masks = masks.reshape(-1, *masks.shape[-2:])
        # The surest last, so that it is on top.
        for k in np.argsort(scores, kind="stable"):
            if scores[k] < network.threshold or not 0 <= labels[k] < len(network.classes):
                continue
            if network.classes[labels[k]] is not None:
                add(resized(masks[k] > 0.5, size) > 0, network.classes[labels[k]])
    elif network.kind == "panoptic":
        packed = resized(np.squeeze(network.output(values, "name")), size)
        for value in np.unique(packed[packed >= 0]):
            label = int(value // network.divisor)
            if label < len(network.classes) and network.classes[label] is not None:
                add(packed == value, network.classes[label])
    else:
        labels = class_map(network, values, size)
        for label, entry in enumerate(network.classes):
            mask = labels == label
            if entry is None or not mask.any():
                continue
            if not entry[2]:
                add(mask, entry)
                continue
            parts = components(mask)
            for part in np.unique(parts[parts > 0]):
                add(parts == part, entry)
    # What is covered by others is gone.
    present, areas = np.unique(ids, return_counts=True)
    area_of = dict(zip(present.tolist(), areas.tolist()))
    kept = [dict(s, area=area_of[s["id"]]) for s in segments if s["id"] in area_of]
    return ids, kept
