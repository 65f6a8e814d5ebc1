# SPDX-License-Identifier: BSD-3-Clause
"""Panoptic maps (COCO PNG + JSON) or class maps (8-bit PNG) with Mask2Former of transformers.

    panoptic.py SEQUENCE/image_2 --output panoptic/left
    panoptic.py SEQUENCE/image_2 --output semantic/left --task semantic \\
        --model facebook/mask2former-swin-large-ade-semantic --label-space ade20k_150

The model is a name on the Hugging Face hub or a folder made by save_pretrained().
"""

import io
import json
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "semantics"))
import common  # noqa: E402
from label_files import read_classes  # noqa: E402

LABEL_SPACES = Path(__file__).resolve().parents[2] / "kys" / "data"


def read_label_space(name):
    """{class name: (category id, thing)} of a class file of the kys library, or of any such file."""
    path = Path(name) if name.endswith(".csv") else LABEL_SPACES / f"{name}.classes.csv"
    if not path.exists():
        common.fail(f"{path}: no such label space")
    return {c.name: (c.id, c.thing) for c in read_classes(path)[1]}


def categories_of(model, space):
    """{label of the model: (category id, thing)}; exits naming the first class that is missing.

    Classes go by name. Synonyms differ from hub to data set (ADE20K: windowpane, window): a model
    with all classes of the label space, those it names alike in the same places, goes by place.
    """
    names = {int(label): str(name).split(",")[0].strip()
             for label, name in model.config.id2label.items()}
    unknown = [name for name in names.values() if name not in space]
    if not unknown:
        return {label: space[name] for label, name in names.items()}
    by_place = dict(zip(sorted(names), space))
    if (len(names) != len(space) or 2 * len(unknown) > len(names)
            or any(name in space and by_place[label] != name for label, name in names.items())):
        common.fail(f"the model's class \"{unknown[0]}\" is not in the label space")
    return {label: space[name] for label, name in by_place.items()}


def to_coco(segmentation, segments_info, categories):
    """Ids (H, W) uint32 with 0 void, and segments_info of COCO.

    Segments are numbered anew and stuff is merged by class: the post-processing may use one id
    twice and leaves unassigned pixels as 0 or -1.
    """
    source = np.asarray(segmentation).astype(np.int64)
    ids = np.zeros(source.shape, np.uint32)
    segments, stuff = [], {}
    seen = set()
    for info in segments_info:
        if info["id"] in seen:  # the first one owns the pixels
            continue
        seen.add(info["id"])
        mask = source == info["id"]
        if info["id"] <= 0 or not mask.any():
            continue
        category, thing = categories[int(info["label_id"])]
        number = stuff.get(category) if not thing else None
        if number is None:
            number = len(segments) + 1
            segments.append({"id": number, "category_id": category, "iscrowd": 0})
            if not thing:
                stuff[category] = number
        ids[mask] = number
    for segment in segments:
        mask = ids == segment["id"]
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        segment["area"] = int(mask.sum())
        segment["bbox"] = [int(columns[0]), int(rows[0]), int(columns[-1] - columns[0] + 1),
                           int(rows[-1] - rows[0] + 1)]
    return ids, segments


def png_bytes(array):
    """PNG of an 8-bit grey or RGB array."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(array).save(stream, "PNG")
    return stream.getvalue()


def run_panoptic(image, model, processor, device, threshold):
    """Segmentation (H, W) and segments_info of one image."""
    import torch

    inputs = processor(images=image, return_tensors="pt").to(device)
    with torch.inference_mode():
        outputs = model(**inputs)
    result = processor.post_process_panoptic_segmentation(
        outputs, threshold=threshold, label_ids_to_fuse=set(), target_sizes=[image.shape[:2]])[0]
    return result["segmentation"].cpu().numpy(), result["segments_info"]


def run_semantic(image, model, processor, device):
    """Labels of the model (H, W) of one image."""
    import torch

    inputs = processor(images=image, return_tensors="pt").to(device)
    with torch.inference_mode():
        outputs = model(**inputs)
    return processor.post_process_semantic_segmentation(
        outputs, target_sizes=[image.shape[:2]])[0].cpu().numpy()


def write_document(output, files, segments, space):
    """DIR.json beside the folder, from the segments of every image."""
    annotations, images = [], []
    for i, (file, infos) in enumerate(zip(files, segments)):
        images.append({"id": i, "file_name": file.name})
        annotations.append({"image_id": i, "file_name": f"{file.stem}.png", "segments_info": infos})
    categories = [{"id": id_, "name": name, "isthing": int(thing)}
                  for name, (id_, thing) in space.items()]
    document = {"images": images, "annotations": annotations, "categories": categories}
    common.write_atomic(output.parent / f"{output.name}.json", json.dumps(document).encode())


def class_map(image, model, processor, device, categories):
    """8-bit PNG of category ids."""
    labels = run_semantic(image, model, processor, device)
    lookup = np.array([categories[i][0] for i in sorted(categories)], np.uint8)
    return png_bytes(lookup[labels])


def panoptic_map(image, model, processor, device, threshold, categories):
    """PNG of segment ids, and segments_info of COCO."""
    segmentation, info = run_panoptic(image, model, processor, device, threshold)
    ids, segments = to_coco(segmentation, info, categories)
    rgb = np.stack([ids % 256, ids // 256 % 256, ids // 65536], -1).astype(np.uint8)
    return png_bytes(rgb), segments


def process(files, output, model, processor, space, device, task="panoptic", threshold=0.5,
            overwrite=False):
    """Segments all files into `output`; what is there of the same images, network and settings is kept."""
    output = Path(output)
    common.note_images(output, files[0].parent)
    categories = categories_of(model, space)
    model.to(device).eval()
    settings = json.dumps([task, threshold, common.digest_of_network(model), sorted(categories.items()),
                           str(processor)])
    segments = []
    for file in common.progress(files, task):
        target, made_of = output / f"{file.stem}.png", common.digest_of(settings, file)
        note = None if overwrite else common.read_note(target, made_of)
        if note is None:
            image = common.read_rgb(file)
            if task == "semantic":
                picture, found = class_map(image, model, processor, device, categories), []
            else:
                picture, found = panoptic_map(image, model, processor, device, threshold, categories)
            common.write_atomic(target, picture)
            note = common.write_note(target, made_of, segments=found)
        segments.append(note["segments"])
    if task == "panoptic":
        write_document(output, files, segments, space)


def load(name):
    """Processor and network of a hub name or a folder."""
    from transformers import AutoImageProcessor, Mask2FormerForUniversalSegmentation

    try:
        return (AutoImageProcessor.from_pretrained(name),
                Mask2FormerForUniversalSegmentation.from_pretrained(name))
    except (OSError, ValueError) as error:
        common.fail(f"{name}: cannot load: {common.first_line(error)}")


def main():
    parser = common.arguments(__doc__.splitlines()[0], [("images", "folder of images")])
    parser.add_argument("--task", choices=["panoptic", "semantic"], default="panoptic")
    parser.add_argument("--model", default="facebook/mask2former-swin-large-coco-panoptic")
    parser.add_argument("--label-space", default="coco_panoptic_133")
    parser.add_argument("--threshold", type=float, default=0.5, help="least score of a segment")
    options = parser.parse_args()
    files = common.list_images(options.images)
    space = read_label_space(options.label_space)
    common.need("torch", "torchvision", "scipy", "transformers", "PIL")
    processor, model = load(options.model)
    process(files, options.output, model, processor, space, common.choose_device(options.device),
            options.task, options.threshold, options.overwrite)


if __name__ == "__main__":
    common.run(main)
