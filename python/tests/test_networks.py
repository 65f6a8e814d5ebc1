# SPDX-License-Identifier: BSD-3-Clause
"""Output layouts of segmentation networks: decoders on small tensors, and tiny ONNX networks of each layout;
the model files; execution providers; colour for networks."""

import sys

import numpy as np
import pytest

import kys_slam
from conftest import ROOT

pytest.importorskip("cv2")
yaml = pytest.importorskip("yaml")
onnxruntime = pytest.importorskip("onnxruntime")
onnx = pytest.importorskip("onnx")

from kys_slam import network_file, segment_outputs as outputs  # noqa: E402
from kys_slam.segment_network import NetworkError, SegmentNetwork  # noqa: E402

sys.path.insert(0, str(ROOT / "tests" / "priors"))
from onnx_support import write_graph  # noqa: E402

MODELS = ROOT / "tools" / "perception" / "models"
HEIGHT, WIDTH = 40, 120
CITY = kys_slam.LabelSpace("cityscapes_19")
COCO = kys_slam.LabelSpace("coco_panoptic_133")
CAR, ROAD, PERSON = (COCO.names.index(name) for name in ("car", "road", "person"))
LOW, HIGH = -8.0, 8.0


def number(space, name):
    """Of the data set."""
    return space.ids[space.names.index(name)]


# --- decoders ---------------------------------------------------------------------------------------------

def raw_detections(objects, classes=3, weights=2, anchors=6):
    """(1, 4 + classes + weights, anchors) of (box centre, size; label, score; weights)."""
    tensor = np.zeros((1, 4 + classes + weights, anchors), np.float32)
    for k, (box, label, score, weight) in enumerate(objects):
        tensor[0, :4, k], tensor[0, 4 + label, k], tensor[0, 4 + classes:, k] = box, score, weight
    return tensor


def halves():
    """Two prototypes of 4 by 6: the left half, the right half."""
    left = np.full((4, 6), LOW, np.float32)
    left[:, :3] = HIGH
    return np.stack([left, -left])[None]


def test_prototypes_make_masks_within_their_boxes():
    # An image of 40 by 60; the box of the first object covers columns 0 to 20 and rows 10 to 30.
    objects = [((10, 20, 20, 20), 1, 0.9, (1, 0)), ((45, 20, 30, 40), 2, 0.6, (0, 1)),
               ((45, 20, 30, 40), 0, 0.2, (0, 1))]
    found = outputs.prototypes_of(raw_detections(objects), halves(), 3, (40, 60), 0.25)
    assert found.labels.tolist() == [1, 2] and found.scores == pytest.approx([0.9, 0.6])
    inside = found.masks > 0
    assert np.argwhere(inside[0]).tolist() == [[r, c] for r in (1, 2) for c in (0, 1)]
    assert inside[1, :, 3:].all() and not inside[1, :, :3].any()


def test_boxes_of_one_object_are_one_object():
    objects = [((10, 20, 20, 20), 1, 0.5, (1, 0)), ((10, 20, 20, 21), 1, 0.9, (1, 0)),
               ((10, 20, 20, 20), 2, 0.8, (1, 0)), ((22, 20, 20, 20), 1, 0.7, (1, 1))]
    found = outputs.prototypes_of(raw_detections(objects), halves(), 3, (40, 60), 0.25)
    assert found.labels.tolist() == [1, 2, 1] and found.scores == pytest.approx([0.9, 0.8, 0.7])


def test_final_detections_have_corners_and_classes():
    rows = np.zeros((1, 5, 8), np.float32)
    rows[0, 0] = 0, 10, 20, 30, 0.9, 2, 1, 0
    rows[0, 1] = 0, 10, 20, 30, 0.8, 1, np.nan, 0
    found = outputs.prototypes_of(rows, halves(), 3, (40, 60), 0.25)
    assert found.labels.tolist() == [2]
    assert np.count_nonzero(found.masks[0] > 0) == 4


@pytest.mark.parametrize("detections, prototypes", [
    (np.zeros((1, 10, 6)), np.zeros((1, 2, 4, 6))), (np.zeros(9), np.zeros((1, 2, 4, 6))),
    (np.zeros((1, 9, 6)), np.zeros((4, 6)))])
def test_other_shapes_are_no_prototypes(detections, prototypes):
    with pytest.raises(outputs.LayoutError, match="detections"):
        outputs.prototypes_of(detections, prototypes, 3, (40, 60), 0.25)


def class_logits(rows, count):
    tensor = np.zeros((1, len(rows), count), np.float32)
    for k, (label, value) in enumerate(rows):
        tensor[0, k, label] = value
    return tensor


def test_queries_with_softmax_have_a_class_for_nothing():
    masks = np.zeros((1, 3, 2, 2), np.float32)
    logits = class_logits([(0, 5), (3, 9), (2, 0.5)], 4)
    found = outputs.queries_of(logits, masks, "softmax", 0.5)
    # exp(5) / (exp(5) + 3) = 0.980; the second is nothing; exp(0.5) / (exp(0.5) + 3) = 0.355 is too little.
    assert found.labels.tolist() == [0] and found.scores == pytest.approx([0.980], abs=1e-3)


def test_queries_with_sigmoid_have_not():
    logits = class_logits([(0, 5), (3, 2)], 4)
    found = outputs.queries_of(logits, np.zeros((1, 2, 2, 2)), "sigmoid", 0.6)
    assert found.labels.tolist() == [0, 3]
    assert found.scores == pytest.approx([0.9933, 0.8808], abs=1e-4)
    with pytest.raises(outputs.LayoutError, match="same queries"):
        outputs.queries_of(logits, np.zeros((1, 3, 2, 2)), "sigmoid", 0.6)


def test_queries_share_the_pixels():
    thing, stuff = ("car", 26, True), ("road", 7, False)
    whole = np.full((4, 6), HIGH, np.float32)
    left, right = whole.copy(), whole.copy()
    left[:, 3:] = right[:, :3] = LOW
    most = whole.copy()
    most[:, 5:] = LOW  # what the better two leave of it is a fifth of nothing
    found = outputs.Found(np.stack([left, right, most, left]), np.array([1, 1, 0, 0]),
                          np.array([0.9, 0.8, 0.7, 0.6]))
    canvas = outputs.Canvas((4, 6))
    outputs.paint_queries(canvas, found, [thing, stuff], lambda mask: mask)
    # Two queries of road are one segment; the cars are covered by it.
    assert [(s["category_id"], s["area"]) for s in canvas.segments()] == [(7, 24)]
    outputs.paint_queries(canvas := outputs.Canvas((4, 6)), found, [stuff, thing], lambda mask: mask)
    assert [(s["category_id"], s["area"]) for s in canvas.segments()] == [(26, 12), (26, 12)]


def test_masks_of_objects_fit_their_scores():
    masks = np.zeros((1, 2, 1, 4, 6))
    masks[0, 1] = 1
    found = outputs.masks_of(masks, [[3, 4]], [[0.2, 0.8]], 0.5)
    assert found.labels.tolist() == [4] and (found.masks > 0).all()
    with pytest.raises(outputs.LayoutError, match="2 masks, 1 labels"):
        outputs.masks_of(masks, [3], [0.2, 0.8], 0.5)


# --- tiny networks of each layout -------------------------------------------------------------------------

def quarter(weights, bias, output):
    """A node: planes at a quarter of the size, weights * red + bias."""
    kernel = np.zeros((len(weights), 3, 4, 4), np.float32)
    kernel[:, 0] = np.array(weights, np.float32)[:, None, None] / 16
    constants = [onnx.numpy_helper.from_array(kernel, f"{output}_kernel"),
                 onnx.numpy_helper.from_array(np.array(bias, np.float32), f"{output}_bias")]
    node = onnx.helper.make_node("Conv", ["image", f"{output}_kernel", f"{output}_bias"], [output],
                                 strides=[4, 4])
    return node, constants


def fixed(values, output):
    """A node that always gives these values."""
    constant = onnx.numpy_helper.from_array(np.asarray(values, np.float32), f"{output}_values")
    return onnx.helper.make_node("Identity", [f"{output}_values"], [output]), [constant]


def write(folder, parts, shapes, settings):
    """tiny.onnx and tiny.yaml."""
    write_graph(folder / "tiny.onnx", [node for node, _ in parts],
                {"image": [1, 3, *settings["input"]["size"]]}, shapes, sum((c for _, c in parts), []))
    (folder / "tiny.yaml").write_text(yaml.safe_dump({"file": "tiny.onnx", **settings}))
    return folder / "tiny.yaml"


def settings_of(output, space="coco_panoptic_133", classes="all", **entry):
    return {"input": {"size": [HEIGHT, WIDTH], "divide_by": 255, **entry}, "output": output,
            "label_space": space, "classes": classes}


def picture(height=HEIGHT, width=WIDTH):
    """Dark, with a bright box in the middle third."""
    image = np.zeros((height, width, 3), np.uint8)
    image[height // 4:height * 3 // 4, width // 3:width * 2 // 3] = 255
    return image


def overlap(ids, segment, image):
    """Intersection over union of a segment and the bright box."""
    own, bright = ids == segment["id"], image[:, :, 0] > 0
    return np.count_nonzero(own & bright) / np.count_nonzero(own | bright)


def test_semantic_logits_at_a_quarter_of_the_size(tmp_path):
    count = len(CITY.names)
    weights, bias = np.zeros(count), np.full(count, -50.0)
    bias[CITY.names.index("road")] = 0
    weights[CITY.names.index("car")], bias[CITY.names.index("car")] = 20, -10
    model = write(tmp_path, [quarter(weights, bias, "logits")], {"logits": [1, count, 10, 30]},
                  settings_of({"kind": "semantic", "name": "logits"}, "cityscapes_19"))
    image = picture()
    ids, segments = SegmentNetwork(model).segment(image)
    assert [s["category_id"] for s in segments] == [number(CITY, "road"), number(CITY, "car")]
    assert overlap(ids, segments[1], image) > 0.95


def prototype_parts(final, things):
    """A car where it is bright and a person where it is dark, both within boxes; the car found twice."""
    prototypes = quarter([16, -16], [-8, 8], "output1")
    middle, right = (60, 20, 56, 32), (110, 20, 20, 40)
    objects = [(middle, things.index("car"), 0.8, (1, 0)), (middle, things.index("car"), 0.6, (1, 0)),
               (right, things.index("person"), 0.7, (0, 1)), (right, things.index("dog"), 0.1, (0, 1))]
    if not final:
        return [fixed(raw_detections(objects, len(things), 2, 12), "output0"), prototypes]
    rows = np.zeros((1, 10, 8), np.float32)
    for k, ((x, y, w, h), label, score, weight) in enumerate(o for i, o in enumerate(objects) if i != 1):
        rows[0, k] = x - w / 2, y - h / 2, x + w / 2, y + h / 2, score, label, *weight
    return [fixed(rows, "output0"), prototypes]


@pytest.mark.parametrize("final", [False, True])
def test_prototypes_end_to_end(tmp_path, final):
    things = [name for name, thing in zip(COCO.names, COCO.things) if thing]
    assert len(things) == 80
    parts = prototype_parts(final, things)
    shape = [1, 10, 8] if final else [1, 86, 12]
    output = {"kind": "prototypes", "detections": "output0", "prototypes": "output1", "min_score": 0.25}
    model = write(tmp_path, parts, {"output0": shape, "output1": [1, 2, 10, 30]},
                  settings_of(output, classes="things"))
    image = picture()
    ids, segments = SegmentNetwork(model).segment(image)
    assert sorted(s["category_id"] for s in segments) == [number(COCO, "person"), number(COCO, "car")]
    car = next(s for s in segments if s["category_id"] == number(COCO, "car"))
    assert overlap(ids, car, image) > 0.9 and car["isthing"] == 1
    assert ids[20, 110] not in (0, car["id"]) and ids[20, 20] == 0


def query_parts(activation):
    """The bright box is a car, the rest is road; a third query is nothing (softmax) or weak (sigmoid)."""
    count = len(COCO.names) + 1 if activation == "softmax" else max(COCO.ids) + 1
    label = {"softmax": (CAR, ROAD, count - 1), "sigmoid": (COCO.ids[CAR], COCO.ids[PERSON], 5)}[activation]
    values = (HIGH, 7, HIGH) if activation == "softmax" else (6, 5, -6)
    rest = LOW if activation == "sigmoid" else 0
    logits = np.full((1, 3, count), rest, np.float32)
    for k, (index, value) in enumerate(zip(label, values)):
        logits[0, k, index] = value
    return [fixed(logits, "logits"), quarter([16, -16, 0], [-8, 8, 8], "masks")], count


@pytest.mark.parametrize("activation", ["softmax", "sigmoid"])
def test_queries_end_to_end(tmp_path, activation):
    parts, count = query_parts(activation)
    output = {"kind": "queries", "activation": activation, "logits": "logits", "masks": "masks"}
    model = write(tmp_path, parts, {"logits": [1, 3, count], "masks": [1, 3, 10, 30]},
                  settings_of(output, classes="all" if activation == "softmax" else "ids"))
    image = picture()
    ids, segments = SegmentNetwork(model).segment(image)
    other = "road" if activation == "softmax" else "person"
    assert {s["category_id"] for s in segments} == {number(COCO, "car"), number(COCO, other)}
    car = next(s for s in segments if s["category_id"] == number(COCO, "car"))
    assert overlap(ids, car, image) > 0.9
    assert np.count_nonzero(ids) == ids.size


def test_a_letterbox_keeps_proportions(tmp_path):
    """An image of 60 by 60 in an input of 40 by 120: its middle third."""
    output = {"kind": "queries", "activation": "sigmoid", "logits": "logits", "masks": "masks"}
    parts, count = query_parts("sigmoid")
    model = write(tmp_path, parts, {"logits": [1, 3, count], "masks": [1, 3, 10, 30]},
                  settings_of(output, classes="ids", fit="letterbox"))
    network = SegmentNetwork(model)
    image = picture(60, 60)
    prepared = network.prepare(image)[0, 0]
    assert (prepared[:, :40] == np.float32(114 / 255)).all() and (prepared[:, 80:] == prepared[0, 0]).all()
    assert prepared[20, 60] == 1 and prepared[2, 60] == 0
    ids, segments = network.segment(image)
    car = next(s for s in segments if s["category_id"] == number(COCO, "car"))
    assert overlap(ids, car, image) > 0.85
    stretched = write(tmp_path, parts, {"logits": [1, 3, count], "masks": [1, 3, 10, 30]},
                      settings_of(output, classes="ids"))
    assert SegmentNetwork(stretched).prepare(image)[0, 0, 20, 20] == 0


def test_a_network_of_another_layout_is_named(tmp_path):
    output = {"kind": "queries", "logits": "logits", "masks": "masks"}
    model = write(tmp_path, [fixed(np.zeros((1, 2, 5)), "logits"), quarter([1, 1, 1], [0, 0, 0], "masks")],
                  {"logits": [1, 2, 5], "masks": [1, 3, 10, 30]}, settings_of(output))
    with pytest.raises(NetworkError, match="tiny.yaml.*same queries.*queries"):
        SegmentNetwork(model).segment(picture())


@pytest.mark.parametrize("change, text", [
    ({"classes": "some"}, "classes is 'some', not one of all, things, ids"),
    ({"output": {"kind": "queries", "activation": "tanh"}}, "output.activation"),
    ({"input": {"size": [HEIGHT, WIDTH], "fit": "crop"}}, "input.fit is 'crop'")])
def test_wrong_words_are_named(tmp_path, change, text):
    model = write(tmp_path, [quarter([1], [0], "logits")], {"logits": [1, 1, 10, 30]},
                  {**settings_of({"kind": "semantic"}), **change})
    with pytest.raises(NetworkError, match=text):
        SegmentNetwork(model)


# --- model files ------------------------------------------------------------------------------------------

def network_for(name, folder, size):
    """A tiny ONNX network with the outputs that a model file names."""
    settings = yaml.safe_load((MODELS / f"{name}.yaml").read_text())
    output, (height, width) = settings["output"], size
    low = [height // 4, width // 4]
    if output["kind"] == "semantic":
        parts, shapes = [quarter([1] * 19, [0] * 19, output["name"])], {output["name"]: [1, 19, *low]}
    elif output["kind"] == "prototypes":
        parts = [fixed(np.zeros((1, 86, 12)), output["detections"]),
                 quarter([16, -16], [-8, 8], output["prototypes"])]
        shapes = {output["detections"]: [1, 86, 12], output["prototypes"]: [1, 2, *low]}
    else:
        count = 134 if output["activation"] == "softmax" else 91
        parts = [fixed(np.zeros((1, 3, count)), output["logits"]),
                 quarter([1, 1, 1], [0, 0, 0], output["masks"])]
        shapes = {output["logits"]: [1, 3, count], output["masks"]: [1, 3, *low]}
    write_graph(folder / "tiny.onnx", [node for node, _ in parts], {"image": [1, 3, height, width]}, shapes,
                sum((c for _, c in parts), []))
    return folder / "tiny.onnx"


@pytest.mark.parametrize("name", ["yolo_seg", "rfdetr_seg", "segformer_cityscapes", "mask2former_coco",
                                  "eomt_coco"])
def test_model_files_read_networks_of_their_layout(tmp_path, name):
    text = (MODELS / f"{name}.yaml").read_text()
    assert "# untried" in text and "# Export" in text
    size = yaml.safe_load(text)["input"]["size"]
    network = SegmentNetwork(MODELS / f"{name}.yaml", network_for(name, tmp_path, size))
    ids, segments = network.segment(picture(90, 300))
    assert ids.shape == (90, 300) and len(segments) <= 1
    assert f"`{name}.yaml`" in (ROOT / "docs" / "guide.md").read_text()


# --- execution providers ----------------------------------------------------------------------------------

def tiny(folder, **more):
    return write(folder, [quarter([1, -1], [0, 0.5], "logits")], {"logits": [1, 2, 10, 30]},
                 {**settings_of({"kind": "semantic"}, classes=["car", "road"]), **more})


def test_providers_by_name(tmp_path):
    network = SegmentNetwork(tiny(tmp_path), provider="cpu")
    assert network.session.get_providers() == ["CPUExecutionProvider"]
    assert SegmentNetwork(tiny(tmp_path, provider="cpu")).session.get_providers() == ["CPUExecutionProvider"]


@pytest.mark.parametrize("name, why", [("gpu", "is not known"), ("cuda", "is not installed")])
def test_a_provider_that_is_not_there_is_refused(tmp_path, monkeypatch, name, why):
    monkeypatch.setattr(onnxruntime, "get_available_providers",
                        lambda: ["OpenVINOExecutionProvider", "CPUExecutionProvider"])
    for model, given in ((tiny(tmp_path), name), (tiny(tmp_path, provider=name), None)):
        with pytest.raises(NetworkError) as refused:
            SegmentNetwork(model, provider=given)
        assert str(refused.value) == (f"{model}: the provider '{name}' {why}; this ONNX Runtime has: "
                                      "cpu, openvino")


def test_a_provider_that_falls_back_is_refused(tmp_path, monkeypatch):
    """As ONNX Runtime for CUDA does on a machine without its libraries."""
    monkeypatch.setattr(onnxruntime, "get_available_providers",
                        lambda: ["CUDAExecutionProvider", "CPUExecutionProvider"])
    session = onnxruntime.InferenceSession
    asked = []

    def falls_back(file, options, providers):
        asked.append(providers)
        return session(file, options, providers=["CPUExecutionProvider"])

    monkeypatch.setattr(onnxruntime, "InferenceSession", falls_back)
    with pytest.raises(NetworkError, match="provider 'cuda' cannot be used on this machine"):
        SegmentNetwork(tiny(tmp_path), provider="cuda")
    assert asked == [["CUDAExecutionProvider", "CPUExecutionProvider"]]
    assert set(network_file.PROVIDERS) >= {"cpu", "cuda", "tensorrt", "openvino"}
