"""Panoptic maps (COCO PNG + JSON) with any segmentation network as ONNX file, by ONNX Runtime.

    segment_onnx.py SEQUENCE/image_0 --model NETWORK.yaml --output panoptic/left [--weights FILE.onnx]

NETWORK.yaml says what the network wants and gives (README.md, models/*.yaml). Networks that give
classes only get instances by connected components of things; build_priors splits these where their
depth shows several objects (segments.split_by_depth).
"""

import concurrent.futures
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import common  # noqa: E402
from panoptic import read_label_space  # noqa: E402

MIN_PIXELS = 150       # of an instance found by connected components
MAPS_VERSION = 2       # raised when the same images give other maps
KINDS = ("semantic", "classes", "panoptic", "instances")


class Network:
    """An ONNX network and what its YAML file says about it."""

    def __init__(self, settings, weights=None, threshold=None):
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
            self._read_settings(settings, threshold)
        self.file = Path(weights) if weights else self.path.parent / str(self.settings.get("file", ""))
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1  # several images at a time: the same result for any number
        options.log_severity_level = 3
        try:
            self.session = onnxruntime.InferenceSession(
                str(self.file), options, providers=onnxruntime.get_available_providers())
        except Exception as error:  # onnxruntime has no common base class of its errors
            common.fail(f"{self.file}: cannot be loaded: {common.first_line(error)}")
        self.digest = common.digest_of(self.file)
        self.input = self.session.get_inputs()[0].name
        self.outputs = [o.name for o in self.session.get_outputs()]

    def _read_settings(self, settings, threshold):
        """Values of the YAML file; raises whatever a wrong one gives."""
        self.kind = self._get("output", "kind")
        if self.kind not in KINDS:
            common.fail(f"{settings}: output.kind is '{self.kind}', not one of {', '.join(KINDS)}")
        default = 0.5 if self.kind == "instances" else 0.0
        given = self.settings["output"].get("min_score", default)
        self.threshold = self._finite("output.min_score", given if threshold is None else threshold)
        self.divisor = self._positive("output.divisor", self.settings["output"].get("divisor", 256))
        size, entry = self._get("input", "size"), self.settings["input"]
        if not (isinstance(size, list) and len(size) == 2 and
                all(isinstance(v, int) and 0 < v <= 16384 for v in size)):
            common.fail(f"{settings}: input.size is '{size}', not [height, width] in px")
        self.height, self.width = size
        self.gamma = self._positive("input.gamma", entry.get("gamma", 1))
        self.divide_by = self._positive("input.divide_by", entry.get("divide_by", 255))
        channels = lambda name, default, check: np.array(
            [check(f"input.{name}", v) for v in np.broadcast_to(entry.get(name, default), 3).tolist()],
            np.float32)
        self.mean = channels("mean", 0, self._finite)
        self.deviation = channels("deviation", 1, self._positive)
        self.bgr = entry.get("colour", "rgb") == "bgr"
        space_name = self._get("label_space")
        self.label_space = self._beside(space_name)
        space = read_label_space(self.label_space)
        self.classes = []
        for name in self._get("classes"):
            if name is not None and name not in space:
                common.fail(f"{settings}: class '{name}' is not in label space {space_name}")
            self.classes.append(None if name is None else (name, *space[name]))

    def description(self):
        """What its maps depend on beside the images."""
        return json.dumps({"version": MAPS_VERSION, "settings": self.settings, "weights": self.digest,
                           "threshold": self.threshold, "classes": self.classes},
                          sort_keys=True, default=str)

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

    def _beside(self, name):
        """A label space as the programs take it: the path of its files without their endings where they
        are beside the YAML file, else its name."""
        beside = self.path.resolve().parent / str(name)
        return str(beside) if beside.with_name(f"{beside.name}.classes.csv").exists() else name

    def prepare(self, image):
        """(1, 3, h, w) float32 of an (H, W, 3) RGB image."""
        import cv2

        if self.gamma != 1:
            image = (255 * (np.arange(256) / 255) ** self.gamma).astype(np.uint8)[image]
        small = cv2.resize(image, (self.width, self.height), interpolation=cv2.INTER_LINEAR)
        scaled = small.astype(np.float32) / self.divide_by
        scaled -= self.mean
        scaled /= self.deviation
        if self.bgr:
            scaled = scaled[:, :, ::-1]
        return np.ascontiguousarray(scaled.transpose(2, 0, 1)[None])

    def run(self, image):
        """Outputs of the network by name."""
        try:
            values = self.session.run(None, {self.input: self.prepare(image)})
        except Exception as error:  # onnxruntime has no common base class of its errors
            common.fail(f"{self.file}: takes no images of {self.width}x{self.height} px (input.size of "
                        f"{self.path}): {common.first_line(error)}")
        return dict(zip(self.outputs, values))

    def output(self, values, key):
        name = self.settings["output"].get(key)
        if name is None and len(values) == 1:
            return next(iter(values.values()))
        if name not in values:
            common.fail(f"{self.path}: output.{key} is '{name}', the network has "
                        f"{', '.join(values)}")
        return values[name]


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


def read_image(path):
    import cv2

    try:
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    except cv2.error:  # too large
        image = None
    if image is None:
        common.fail(f"{path}: cannot read")
    return np.ascontiguousarray(image[:, :, ::-1])


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

    pool = concurrent.futures.ThreadPoolExecutor(jobs)
    try:
        work = [pool.submit(segment, path) for path in images]
        done = [item.result() for item in common.progress(work, label)]
    finally:
        pool.shutdown(cancel_futures=True)
    notes = [note for note, _ in done]
    annotations = [{"file_name": f"{path.stem}.png", "segments_info": note["segments"]}
                   for path, note in zip(images, notes)]
    common.write_atomic(output.with_name(output.name + ".json"),
                        json.dumps({"annotations": annotations}).encode("ascii"))
    times = {stage: sum(note["seconds"][stage] for note in notes) for stage in ("network", "segments")}
    return {**times, "frames": sum(new for _, new in done)}


def add_jobs(parser):
    parser.add_argument("--jobs", type=common.whole(1), default=os.cpu_count() or 1,
                        help="threads (default: all)")


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
