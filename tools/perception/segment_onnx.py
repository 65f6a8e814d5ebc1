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
from onnx_network import OnnxNetwork, add_jobs, in_threads, read_image, segment_network  # noqa: E402
from panoptic import read_label_space  # noqa: E402


class Network(OnnxNetwork, segment_network.SegmentNetwork):
    """An ONNX network for segmentation and what its YAML file says about it."""

    @staticmethod
    def _read_space(name):
        return read_label_space(name)


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
    ids, segments = segment_network.to_panoptic(network, values, image.shape[:2])
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
