# SPDX-License-Identifier: BSD-3-Clause
"""Panoptic maps (COCO PNG + JSON) with any segmentation network as ONNX file, by ONNX Runtime.

    segment_onnx.py SEQUENCE/image_0 --model NETWORK.yaml --output panoptic/left [--weights FILE.onnx]

NETWORK.yaml says what the network wants and gives (README.md, models/*.yaml). Networks that give
classes only get instances by connected components of things; build_priors splits these where their
depth shows several objects (segments.split_by_depth).
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import common  # noqa: E402
from onnx_network import OnnxNetwork, add_jobs, in_threads, read_image  # noqa: E402
from panoptic import read_label_space  # noqa: E402

MIN_PIXELS = 150       # of an instance found by connected components
MAPS_VERSION = 2       # raised when the same images give other maps
KINDS = ("semantic", "classes", "panoptic", "instances")


class Network(OnnxNetwork):
    """An ONNX network for segmentation and what its YAML file says about it."""

    def __init__(self, settings, weights=None, threshold=None):
        self.threshold = threshold
        super().__init__(settings, weights)
        self.input = self.inputs[0]

    def _read_settings(self):
        self.kind = self._get("output", "kind")
        if self.kind not in KINDS:
            common.fail(f"{self.path}: output.kind is '{self.kind}', not one of {', '.join(KINDS)}")
        default = 0.5 if self.kind == "instances" else 0.0
        given = self.settings["output"].get("min_score", default)
        self.threshold = self._finite("output.min_score",
                                      given if self.threshold is None else self.threshold)
        self.divisor = self._positive("output.divisor", self.settings["output"].get("divisor", 256))
        self._read_input()
        space_name = self._get("label_space")
        self.label_space = self._beside(space_name)
        space = read_label_space(self.label_space)
        self.classes = []
        for name in self._get("classes"):
            if name is not None and name not in space:
                common.fail(f"{self.path}: class '{name}' is not in label space {space_name}")
            self.classes.append(None if name is None else (name, *space[name]))

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
            common.fail(f"{network.path}: the network gives {found.shape}, not "
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


def write_ids(path, ids):
    import cv2

    channels = np.stack([(ids >> shift) & 255 for shift in (16, 8, 0)], axis=-1).astype(np.uint8)
    good, data = cv2.imencode(".png", channels)  # BGR
    if not good:
        common.fail(f"{path}: cannot be encoded")
    common.write_atomic(path, data.tobytes())


def segment_image(network, path):
    """Ids and segments of an image, and the seconds for them."""
    image = read_image(path)
    start = time.perf_counter()
    values = network.run(image)
    between = time.perf_counter()
    ids, segments = to_panoptic(network, values, image.shape[:2])
    return ids, segments, {"network": between - start, "segments": time.perf_counter() - between}


def segment_folder(network, images, output, overwrite=False, label="segmentation", jobs=1):
    """Writes OUTPUT/<name>.png and OUTPUT.json, `jobs` images at a time. Maps that are there are kept
    if they were made of the same images in the same way. Returns the number of maps made now, and
    seconds in the network and beside it for all images, summed; those of kept maps are as measured."""
    output = Path(output)
    if images:
        common.note_images(output, Path(images[0]).parent)
    description = network.description()

    def segment(path):
        """The note of its map, and whether the map is new."""
        picture = output / f"{path.stem}.png"
        made_of = common.digest_of(description, path)
        note = None if overwrite else common.read_note(picture, made_of)
        if note is not None:
            return note, False
        ids, segments, seconds = segment_image(network, path)
        write_ids(picture, ids)
        return common.write_note(picture, made_of, segments=segments, seconds=seconds), True

    done = in_threads(segment, images, label, jobs)
    notes = [note for note, _ in done]
    annotations = [{"file_name": f"{path.stem}.png", "segments_info": note["segments"]}
                   for path, note in zip(images, notes)]
    common.write_atomic(output.with_name(output.name + ".json"),
                        json.dumps({"annotations": annotations}).encode("ascii"))
    times = {stage: sum(note["seconds"][stage] for note in notes) for stage in ("network", "segments")}
    return {**times, "frames": sum(new for _, new in done)}


def main():
    parser = common.arguments(__doc__.splitlines()[0], [("images", "folder of images")])
    parser.add_argument("--model", required=True, help="YAML file of the network")
    parser.add_argument("--weights", help="ONNX file (default: what the YAML file names)")
    parser.add_argument("--threshold", type=float, help="least score (instances) or probability "
                        "(semantic) of a thing (default: output.min_score; 0.5 and 0)")
    add_jobs(parser)
    options = parser.parse_args()
    common.need("onnxruntime", "yaml", "cv2")
    network = Network(options.model, options.weights, options.threshold)
    images = common.list_images(options.images)
    made = segment_folder(network, images, options.output, options.overwrite, jobs=options.jobs)
    print(f"{made['frames']} frames, {len(images) - made['frames']} kept, network "
          f"{1e3 * made['network'] / len(images):.0f} ms, segments "
          f"{1e3 * made['segments'] / len(images):.0f} ms per frame")


if __name__ == "__main__":
    common.run(main)
