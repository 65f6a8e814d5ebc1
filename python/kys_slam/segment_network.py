# SPDX-License-Identifier: BSD-3-Clause
"""Segmentation networks as ONNX files, by ONNX Runtime. A YAML file says what the network wants and gives
(docs/guide.md, "Networks beside the tracker"). Without the rest of the package: tools/perception uses it
too.

    network = SegmentNetwork("network.yaml")
    ids, segments = network.segment(image)   # (H, W, 3) uint8, RGB

Needs onnxruntime, PyYAML and OpenCV.
"""

import numpy as np

try:
    from . import segment_outputs as outputs
    from .network_file import PROVIDERS, NetworkError, OnnxNetwork, first_line, need  # noqa: F401
except ImportError:  # tools/perception
    import segment_outputs as outputs
    from network_file import PROVIDERS, NetworkError, OnnxNetwork, first_line, need  # noqa: F401

MAPS_VERSION = 3       # raised when the same images give other maps
KINDS = ("semantic", "classes", "panoptic", "instances", "prototypes", "queries")
OBJECT_KINDS = KINDS[3:]
FITS = ("stretch", "letterbox")
PADDING = 114          # grey level around a letterbox, as Ultralytics trains with


class SegmentNetwork(OnnxNetwork):
    """An ONNX network for segmentation and what its YAML file says about it."""

    def __init__(self, settings, weights=None, threshold=None, threads=1, provider=None):
        self.threshold = threshold
        super().__init__(settings, weights, threads, provider)
        self.input = self.inputs[0]

    def _read_settings(self):
        self.kind = self._one_of("output.kind", self._get("output", "kind"), KINDS)
        entry = self.settings["output"]
        self.activation = self._one_of("output.activation", entry.get("activation", "softmax"),
                                       ("softmax", "sigmoid"))
        default = 0.5 if self.kind in OBJECT_KINDS else 0.0
        given = entry.get("min_score", default)
        self.threshold = self._finite("output.min_score",
                                      given if self.threshold is None else self.threshold)
        self.divisor = self._positive("output.divisor", entry.get("divisor", 256))
        self._read_input()
        self.fit = self._one_of("input.fit", self.settings["input"].get("fit", "stretch"), FITS)
        space_name = self._get("label_space")
        self.label_space = self._beside(space_name)
        space = self._read_space(self.label_space)
        self.classes = []
        for name in self._class_names(space):
            if name is not None and name not in space:
                self.fail(f"{self.path}: class '{name}' is not in label space {space_name}")
            self.classes.append(None if name is None else (name, *space[name]))

    def _one_of(self, key, value, known):
        if value not in known:
            self.fail(f"{self.path}: {key} is '{value}', not one of {', '.join(known)}")
        return value

    def _class_names(self, space):
        """By index of the network; None: void. A list, or what the label space has: "all" its classes,
        its "things", or "ids": the network's index is the number of the class in the data set."""
        given = self._get("classes")
        if not isinstance(given, str):
            return given
        self._one_of("classes", given, ("all", "things", "ids"))
        if given == "ids":
            names = {number: name for name, (number, _) in space.items()}
            return [names.get(i) for i in range(max(names) + 1)]
        return [name for name, (_, thing) in space.items() if thing or given == "all"]

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
        more = {"provider": self.provider} if self.provider else {}
        return super().description(version=MAPS_VERSION, threshold=self.threshold, classes=self.classes,
                                   **more)

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

    def _letterbox(self, size):
        """Scale of an image of this size (height, width), and its left upper corner, px of the input."""
        scale = min(self.height / size[0], self.width / size[1])
        inner = [max(1, round(scale * side)) for side in size]
        return inner, ((self.height - inner[0]) // 2, (self.width - inner[1]) // 2)

    def _fitted(self, image):
        import cv2

        if self.fit == "stretch":
            return super()._fitted(image)
        (height, width), (top, left) = self._letterbox(image.shape[:2])
        fitted = np.full((self.height, self.width, *image.shape[2:]), PADDING, np.uint8)
        fitted[top:top + height, left:left + width] = cv2.resize(image, (width, height),
                                                                 interpolation=cv2.INTER_LINEAR)
        return fitted

    def enlarged(self, plane, size, nearest=False):
        """An (h, w) map of the network's image at the size (height, width) of the image."""
        import cv2

        plane = np.ascontiguousarray(plane, np.float32)
        how = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
        if self.fit == "stretch":
            return cv2.resize(plane, size[::-1], interpolation=how)
        (height, width), (top, left) = self._letterbox(size)
        # Pixel x of the image is at ((x + 0.5) width / W + left) w / w_input - 0.5 of the map.
        rows, columns = plane.shape[0] / self.height, plane.shape[1] / self.width
        by_row, by_column = height / size[0] * rows, width / size[1] * columns
        back = np.array([[by_column, 0, 0.5 * by_column + left * columns - 0.5],
                         [0, by_row, 0.5 * by_row + top * rows - 0.5]])
        return cv2.warpAffine(plane, back, size[::-1], flags=how | cv2.WARP_INVERSE_MAP,
                              borderMode=cv2.BORDER_REPLICATE)


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
    found = network.output(values, "name")
    found = found[0] if found.ndim == 4 or (found.ndim == 3 and network.kind == "classes") else found
    if network.kind == "classes":
        labels = network.enlarged(np.squeeze(found), size, nearest=True).astype(np.int64)
    else:
        if found.ndim != 3 or found.shape[0] < len(network.classes):
            network.fail(f"{network.path}: the network gives {found.shape}, not "
                         f"{len(network.classes)} classes by height by width")
        # Logits, not labels, are enlarged: edges stay smooth.
        big = [network.enlarged(plane, size) for plane in found]
        labels = np.argmax(big, axis=0)
        if network.threshold > 0:
            labels = without_weak_things(network, np.asarray(big), labels)
    labels[(labels < 0) | (labels >= len(network.classes))] = -1
    return labels


def found_objects(network, values):
    """outputs.Found, of kinds instances, prototypes and queries."""
    get = lambda key: network.output(values, key)
    if network.kind == "instances":
        return outputs.masks_of(get("masks"), get("labels"), get("scores"), network.threshold)
    if network.kind == "prototypes":
        return outputs.prototypes_of(get("detections"), get("prototypes"), len(network.classes),
                                     (network.height, network.width), network.threshold)
    return outputs.queries_of(get("logits"), get("masks"), network.activation, network.threshold)


def to_panoptic(network, values, size):
    """Ids (H, W) with 0 void, and segments_info of COCO."""
    canvas = outputs.Canvas(size)
    if network.kind in OBJECT_KINDS:
        try:
            found = found_objects(network, values)
        except outputs.LayoutError as error:
            network.fail(f"{network.path}: the network gives {error} (output.kind {network.kind})")
        paint = outputs.paint_queries if network.kind == "queries" else outputs.paint_objects
        paint(canvas, found, network.classes, lambda mask: network.enlarged(mask, size))
    elif network.kind == "panoptic":
        packed = np.squeeze(network.output(values, "name"))
        packed = network.enlarged(packed, size, nearest=True).astype(np.int64)
        for value in np.unique(packed[packed >= 0]):
            label = int(value // network.divisor)
            if label < len(network.classes) and network.classes[label] is not None:
                canvas.add(packed == value, network.classes[label])
    else:
        outputs.paint_classes(canvas, class_map(network, values, size), network.classes)
    return canvas.ids, canvas.segments()
