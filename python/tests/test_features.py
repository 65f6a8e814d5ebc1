# SPDX-License-Identifier: BSD-3-Clause
"""Features of one's own in place of ORB: functions, networks, distances of descriptors."""

import json
import sys

import numpy as np
import pytest

import kys_slam
from conftest import ROOT
from kys_slam import Features, InputError, binarise
from kys_slam.cli import main

cv2 = pytest.importorskip("cv2")
sys.path.insert(0, str(ROOT / "tests" / "priors"))
sys.path.insert(0, str(ROOT / "examples"))
import onnx_support  # noqa: E402

needs_onnx = pytest.mark.skipif(bool(onnx_support.MISSING), reason=onnx_support.MISSING)


def patches(image):
    """Corners with the grey levels around them, floats."""
    corners = cv2.goodFeaturesToTrack(image, 700, 0.005, 5)
    at = np.zeros((0, 2)) if corners is None else corners.reshape(-1, 2)
    height, width = image.shape
    at = at[(at > 10).all(axis=1) & (at[:, 0] < width - 11) & (at[:, 1] < height - 11)]
    blurred = cv2.GaussianBlur(image, (0, 0), 1.5).astype(np.float32)
    x, y = at.round().astype(int).T
    steps = np.arange(-8, 9, 2)
    values = blurred[(y[:, None] + steps)[:, :, None], (x[:, None] + steps)[:, None, :]].reshape(len(at), -1)
    return at, values - values.mean(axis=1, keepdims=True)


@pytest.fixture(scope="module")
def recording(corridor, tmp_path_factory):
    """The corridor as a KITTI sequence."""
    folder = tmp_path_factory.mktemp("corridor")
    for side in (0, 1):
        (folder / f"image_{side}").mkdir()
        for i, frame in enumerate(corridor):
            cv2.imwrite(str(folder / f"image_{side}" / f"{i:06d}.png"), frame[side])
    (folder / "times.txt").write_text("".join(f"{frame[2]}\n" for frame in corridor))
    (folder / "calib.txt").write_text(
        "P0: 250 0 159.5 0 0 250 119.5 0 0 0 1 0\nP1: 250 0 159.5 -50 0 250 119.5 0 0 0 1 0\n")
    return folder


def run(corridor, camera, features, settings=None, schedule="sequential"):
    slam = kys_slam.System(camera, {"kys.mode": "stock", "orb.features": 600, **(settings or {})}, schedule,
                           features=features)
    for left, right, time, _ in corridor:
        slam.feed(left, right, time)
    slam.finish()
    return slam


def expect_true_path(slam, corridor):
    """To a hundredth of the way, as of stereo odometry in general."""
    trajectory = slam.trajectory()
    assert trajectory.connected.all()
    truth = np.array([p for *_, p in corridor])
    truth -= truth[0]
    error = np.linalg.norm(trajectory.poses[:, :3, 3] - truth, axis=1)
    assert (error < 0.02 + 0.01 * np.linalg.norm(truth, axis=1)).all(), error


def test_bits_follow_the_angle_and_the_seed():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 400, 64)).astype(np.float32)
    bits, others = binarise(a), binarise(b)
    assert bits.shape == (400, 32) and bits.dtype == np.uint8
    cosine = (a * b).sum(1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    distance = np.unpackbits(bits ^ others, axis=1).sum(axis=1)
    expected = 256 * np.arccos(cosine) / np.pi
    # Independent bits: a standard deviation of at most 8 each.
    assert abs((distance - expected).mean()) < 5 * 8 / np.sqrt(400)
    assert (np.abs(distance - expected) < 5 * 8).all()
    assert np.array_equal(bits, binarise(a, seed=0)) and not np.array_equal(bits, binarise(a, seed=1))
    centre = np.full(64, 3.0)
    assert np.array_equal(binarise(a, centre=centre), binarise(a - centre.astype(np.float32)))


def test_bits_with_a_period_follow_the_difference():
    """Of four numbers each has 64 bits: half of them change over half a period, all over one, whatever the
    orthonormal axes are; along them the distance is at most that."""
    rng = np.random.default_rng(2)
    a = rng.normal(size=(300, 4)).astype(np.float32)
    step = rng.normal(size=(300, 4)).astype(np.float32)
    distance = lambda b: np.unpackbits(binarise(a, period=2) ^ binarise(b, period=2), axis=1).sum(axis=1)
    near, twice = distance(a + 0.1 * step), distance(a + 0.2 * step)
    axes = np.abs(step).sum(axis=1)  # an L1 length in any other axes is at most twice and at least half of it
    assert (near <= 2 * axes * 0.1 / 2 * 64 + 4).all() and (near >= axes / 2 * 0.1 / 2 * 64 - 4).all()
    assert abs(twice.mean() / near.mean() - 2) < 0.05
    one = np.zeros((1, 1), np.float32)  # one circle of 256 bits, 2 periods around
    for value, bits in ((0.5, 64), (1, 128), (2, 256), (3, 128), (4, 0)):
        moved = np.full((1, 1), value, np.float32)
        assert np.unpackbits(binarise(one, period=2) ^ binarise(moved, period=2)).sum() == bits


@pytest.mark.parametrize("given", [np.zeros((3, 64, 2)), np.full((2, 64), np.nan), np.zeros((2, 5000))])
def test_what_is_no_descriptor_is_refused(given):
    with pytest.raises(InputError):
        binarise(given)


def test_a_function_tracks_and_its_map_is_its_own(corridor, corridor_camera, tmp_path):
    slam = run(corridor, corridor_camera, patches)
    expect_true_path(slam, corridor)
    again = run(corridor, corridor_camera, patches, schedule="pipelined")
    assert again.trajectory().connected.all()
    assert np.array_equal(slam.trajectory().poses, run(corridor, corridor_camera, patches).trajectory().poses)

    slam.save_map(tmp_path / "a.map")
    settings = {"kys.mode": "stock"}
    later = kys_slam.System(corridor_camera, settings, "sequential", features=patches)
    later.load_map(tmp_path / "a.map", localize_only=True)
    left, right, time, position = corridor[5]
    report = later.feed(left, right, time)
    assert report.relocalised
    assert np.linalg.norm(report.pose[:3, 3] - (position - corridor[0][3])) < 0.05
    for other in (None, Features(patches, "other")):
        with pytest.raises(InputError, match="a.map.*'patches'"):
            kys_slam.System(corridor_camera, settings, features=other).load_map(tmp_path / "a.map")


def test_bits_scores_scales_and_angles_are_taken(corridor, corridor_camera):
    """ORB through Python is ORB, but for its levels, which are rounded scales."""
    settings = kys_slam.Settings({"orb.features": 600})

    def orb(image):
        found, _ = kys_slam._core._orb_features(image, image, settings)
        return {"positions": found["positions"], "descriptors": found["descriptors"],
                "scores": found["scores"], "angles": found["angles"], "scales": 1.2 ** found["octaves"]}

    features = Features(orb, levels=8, oriented=True, reach=1, pixel_sigma=0.35)
    slam = run(corridor, corridor_camera, features)
    own = run(corridor, corridor_camera, None)
    assert np.array_equal(slam.trajectory().poses, own.trajectory().poses)


def test_prior_modes_work(corridor, corridor_camera):
    space = kys_slam.LabelSpace("coco_panoptic_133")
    road = dict(zip(space.names, space.ids))["road"]
    slam = kys_slam.System(corridor_camera, {"kys.mode": "kys"}, "sequential", features=patches)
    for left, right, time, _ in corridor:
        labels = np.full(left.shape, road)
        report = slam.feed(left, right, time, kys_slam.priors_from_labels(space, labels, labels))
        assert report.prior_coverage > 0.9
    slam.finish()
    expect_true_path(slam, corridor)


def test_sigmas_are_levels(corridor, corridor_camera):
    def unsure(image):
        at, values = patches(image)
        return {"positions": at, "descriptors": values, "sigmas": np.where(np.arange(len(at)) % 2, 0.5, 1.0)}

    features = Features(unsure, by_sigma=True, levels=4, scale_factor=2, pixel_sigma=0.5)
    found = features(corridor[0][0])
    assert np.array_equal(found["octaves"], np.where(np.arange(len(found["octaves"])) % 2, 0, 1))
    expect_true_path(run(corridor, corridor_camera, features), corridor)


def test_images_without_features_are_lost_not_an_error(corridor, corridor_camera):
    none = lambda image: (np.zeros((0, 2)), np.zeros((0, 64)))
    slam = kys_slam.System(corridor_camera, features=none)
    left, right, time, _ = corridor[0]
    assert slam.feed(left, right, time).lost


@pytest.mark.parametrize("result, what", [
    (None, "neither"), ((1, 2, 3), "neither"), ({"positions": np.zeros((4, 2))}, "neither"),
    ((np.zeros((4, 3)), np.zeros((4, 64))), r"positions are of shape \(4, 3\)"),
    ((np.zeros((4, 2)), np.zeros((3, 64))), r"descriptors are of shape \(3, 64\), not \(4, D\)"),
    ((np.zeros((4, 2)), np.zeros((4, 16), np.uint8)), "16 bytes, not 32"),
    ((np.full((4, 2), np.nan), np.zeros((4, 64))), "positions are not all finite"),
    ((np.zeros((4, 2)), np.full((4, 64), np.inf)), "descriptors are not all finite"),
    ((np.full((4, 2), -50.0), np.zeros((4, 64))), "outside the image"),
    (("words", np.zeros((4, 64))), "no array of numbers"),
    ({"positions": np.zeros((4, 2)), "descriptors": np.ones((4, 8)), "scores": np.ones(3)}, "scores are of"),
    ({"positions": np.zeros((4, 2)), "descriptors": np.ones((4, 8)), "scales": np.zeros(4)}, "above 0"),
    ({"positions": np.zeros((4, 2)), "descriptors": np.ones((4, 8)), "size": np.zeros(4)}, "'size'"),
])
def test_what_a_function_gives_wrongly_is_refused(corridor, corridor_camera, result, what):
    left, right, time, _ = corridor[0]
    slam = kys_slam.System(corridor_camera, features=Features(lambda image: result, "mine"))
    with pytest.raises(InputError, match=what) as error:
        slam.feed(left, right, time)
    assert "mine" in str(error.value) and "\n" not in str(error.value)
    slam.finish()


@pytest.mark.parametrize("options", [
    {"name": "two words"}, {"levels": 0}, {"levels": 200}, {"scale_factor": 1.0}, {"reach": 0.5},
    {"pixel_sigma": 0.0}, {"period": -1.0}, {"period": float("nan")}, {"distances": {"matching": [1, 2]}}, {"distances": {"matching": [1], "other": [2]}},
])
def test_what_an_extractor_says_wrongly_is_refused(corridor_camera, options):
    with pytest.raises(InputError):
        kys_slam.System(corridor_camera, features=Features(patches, **{"name": "mine", **options}))


def test_an_error_of_the_function_is_raised_and_the_run_can_end(corridor, corridor_camera):
    calls = []

    def fails(image):
        calls.append(1)
        if len(calls) > 8:
            raise KeyError("my own error")
        return patches(image)

    slam = kys_slam.System(corridor_camera, features=fails)
    for left, right, time, _ in corridor[:4]:
        slam.feed(left, right, time)
    with pytest.raises(KeyError, match="my own error"):
        slam.feed(*corridor[4][:3])
    slam.finish()
    assert len(slam.trajectory().poses) == 4


def test_limits_follow_the_distances(corridor, corridor_camera):
    """An extractor whose distances are half of ORB's gets half of the limits, and tracks."""
    from kys_slam._core import _equivalent_distance
    matching = [4, 5, 6, 8, 11, 16, 26, 40, 55, 62, 70, 74, 78]
    other = [19, 25, 31, 34, 39, 43, 49, 56, 63, 70, 76]
    for bits in (50, 75, 100):
        assert abs(_equivalent_distance(bits, matching, other) - bits / 2) < 1.5
    features = Features(patches, distances={"matching": matching, "other": other})
    slam = run(corridor, corridor_camera, features)
    assert slam.trajectory().connected.all()


def test_the_example(kitti, capsys, tmp_path):
    import own_features
    part = tmp_path / "kitti"
    for folder in ("image_0", "image_1"):
        (part / folder).mkdir(parents=True)
        for file in sorted((kitti / folder).iterdir())[:4]:
            (part / folder / file.name).symlink_to(file)
    (part / "calib.txt").write_bytes((kitti / "calib.txt").read_bytes())
    (part / "times.txt").write_text("".join((kitti / "times.txt").read_text().splitlines(True)[:4]))
    own_features.main(str(part))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4
    assert all(line.split()[1] in ("started", "tracked") and int(line.split()[2]) > 100 for line in lines)


# Networks


def write_points_network(folder, size, count=500):
    """Blob detector and random filters: keypoints, scores, descriptors."""
    from onnx import TensorProto, helper, numpy_helper
    height, width = size
    rng = np.random.default_rng(4)
    nodes, constants = [], []

    def constant(value, name):
        constants.append(numpy_helper.from_array(value, name))
        return name

    def add(operator, inputs, out, **attributes):
        nodes.append(helper.make_node(operator, inputs, [out], **attributes))
        return out

    blob = cv2.getGaussianKernel(11, 1.5) @ cv2.getGaussianKernel(11, 1.5).T
    blob -= cv2.getGaussianKernel(11, 2.5) @ cv2.getGaussianKernel(11, 2.5).T
    filters = rng.normal(size=(48, 1, 17, 17)) * np.outer(np.hanning(19)[1:-1], np.hanning(19)[1:-1])
    filters -= filters.mean(axis=(2, 3), keepdims=True)
    add("Conv", ["image", constant(blob[None, None].astype(np.float32), "blob")], "blobs", pads=[5] * 4)
    add("Abs", ["blobs"], "score")
    add("MaxPool", ["score"], "largest", kernel_shape=[7, 7], pads=[3] * 4)
    add("Equal", ["score", "largest"], "peak")
    add("Where", ["peak", "score", constant(np.zeros(1, np.float32), "zero")], "peaks")
    inside = np.zeros((1, 1, height, width), np.float32)
    inside[..., 12:-12, 12:-12] = 1
    add("Mul", ["peaks", constant(inside, "inside")], "kept")
    add("Reshape", ["kept", constant(np.array([-1]), "flat")], "list")
    nodes.append(helper.make_node("TopK", ["list", constant(np.array([count]), "count")], ["scores", "at"]))
    add("Mod", ["at", constant(np.array([width]), "width")], "column")
    add("Div", ["at", "width"], "row")
    for name in ("column", "row"):
        add("Unsqueeze", [name, constant(np.array([1]), f"axis_{name}")], f"{name}s")
    add("Concat", ["columns", "rows"], "xy", axis=1)
    add("Cast", ["xy"], "keypoints", to=TensorProto.FLOAT)
    add("Conv", ["image", constant(filters.astype(np.float32), "filters")], "maps", pads=[8] * 4)
    add("Reshape", ["maps", constant(np.array([48, -1]), "by_map")], "flat_maps")
    add("Gather", ["flat_maps", "at"], "descriptors", axis=1)  # (48, N)
    onnx_support.write_graph(folder / "points.onnx", nodes, {"image": [1, 1, height, width]},
                             {"keypoints": [count, 2], "scores": [count], "descriptors": [48, count]},
                             constants)
    return write_settings(folder, "points", {"size": list(size)}, {"kind": "points"})


def write_settings(folder, name, input_, output, **more):
    import yaml
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump({"name": name, "file": f"{name}.onnx", "input": {"channels": 1, **input_},
                                    "output": output, "features": 500, **more}))
    return path


def write_cells_network(folder):
    """Scores are grey levels, descriptors the mean grey level and its square per cell."""
    from onnx import helper, numpy_helper
    weights = np.ones((1, 1, 8, 8), np.float32) / 64
    nodes = [helper.make_node("SpaceToDepth", ["image"], ["pixels"], blocksize=8),
             helper.make_node("Mul", ["pixels", "gain"], ["logits"]),
             helper.make_node("Conv", ["image", "mean"], ["level"], strides=[8, 8]),
             helper.make_node("Mul", ["level", "zero"], ["nothing"]),
             helper.make_node("Concat", ["logits", "nothing"], ["cells"], axis=1),
             helper.make_node("Add", ["nothing", "one"], ["ones"]),
             helper.make_node("Concat", ["level", "ones"], ["descriptors"], axis=1)]
    constants = [numpy_helper.from_array(np.array([v], np.float32), n)
                 for n, v in (("gain", 8), ("zero", 0), ("one", 1))]
    constants.append(numpy_helper.from_array(weights, "mean"))
    onnx_support.write_graph(folder / "cells.onnx", nodes, {"image": [1, 1, "h", "w"]},
                             {"cells": [1, 65, "h8", "w8"], "descriptors": [1, 2, "h8", "w8"]}, constants)
    return write_settings(folder, "cells", {"multiple": 8}, {"kind": "cells", "min_score": 0.05})


@needs_onnx
def test_cells_are_decoded(tmp_path):
    from kys_slam.feature_network import FeatureNetwork
    network = FeatureNetwork(write_cells_network(tmp_path))
    image = np.zeros((64, 96), np.uint8)
    dots = [(20, 10), (21, 41), (70, 30)]  # x, y
    for x, y in dots:
        image[y, x] = 255
    image[30, 71] = 120  # beside the last one: it lies between the two pixels
    found = network(image)
    order = np.lexsort(found["positions"].T[::-1])
    at = found["positions"][order]
    assert at.shape == (3, 2)
    assert np.allclose(at[:2], dots[:2], atol=0.01)
    assert 70 < at[2, 0] < 70.5 and abs(at[2, 1] - 30) < 0.01
    assert np.allclose(np.linalg.norm(found["descriptors"], axis=1), 1, atol=1e-5)
    assert (np.diff(found["scores"]) <= 0).all()
    assert len(network.features(2)(image)["positions"]) == 2


@needs_onnx
def test_values_between_cells_are_interpolated():
    from kys_slam.feature_network import refined, sampled, score_map
    rows, columns = np.indices((6, 9)).astype(np.float32)
    plane = np.stack([2 * columns - rows, np.ones((6, 9), np.float32)])
    at = np.array([[3.0, 2.0], [3.25, 2.5], [4.5, 3.75]])
    assert np.allclose(sampled(plane, at)[:, 0], 2 * at[:, 0] - at[:, 1], atol=0.15)
    assert np.allclose(sampled(plane, at[:1])[:, 0], 4)
    assert np.allclose(sampled(plane, at)[:, 1], 1)
    x, y = np.meshgrid(np.arange(9), np.arange(7))
    bell = np.exp(-((x - 4.3) ** 2 + (y - 2.8) ** 2) / 4).astype(np.float32)
    assert np.allclose(refined(bell, np.array([3]), np.array([4])), [[4.3, 2.8]], atol=1e-3)
    logits = np.zeros((65, 2, 3), np.float32)
    logits[8 * 5 + 2, 1, 2] = 20  # row 5, column 2 of the cell in row 1, column 2
    scores = score_map(logits)
    assert scores.shape == (16, 24) and np.argmax(scores) == (8 + 5) * 24 + 16 + 2
    assert np.isclose(scores[0, 0], 1 / 65)


@needs_onnx
def test_a_network_runs_from_the_command_line(recording, tmp_path, capsys):
    from kys_slam.demo import CAMERA
    model = write_points_network(tmp_path, (CAMERA["height"], CAMERA["width"]))
    out = tmp_path / "run"
    assert main(["run", str(recording), "--features", str(model), "--output", str(out), "--quiet",
                 "--mode", "stock", "--save-map", str(tmp_path / "a.map")]) == 0
    assert len((out / "trajectory.tum").read_text().splitlines()) == 12
    assert json.loads((out / "summary.json").read_text())["features"].startswith("points:")
    # The same model localises in its map, ORB does not.
    again = ["run", str(recording), "--quiet", "--mode", "stock", "--load-map", str(tmp_path / "a.map"),
             "--localize-only", "--output"]
    assert main([*again, str(tmp_path / "two"), "--features", str(model)]) == 0
    capsys.readouterr()
    assert main([*again, str(tmp_path / "three")]) == 2
    error = capsys.readouterr().err
    assert "a.map" in error and "'points:" in error and error.count("\n") == 1


@needs_onnx
def test_distances_are_measured_and_written(recording, tmp_path, capsys):
    import yaml
    from kys_slam.feature_network import FeatureNetwork
    from kys_slam.demo import CAMERA
    model = write_points_network(tmp_path, (CAMERA["height"], CAMERA["width"]))
    command = ["features", str(recording), "--features", str(model), "--write"]
    assert main(command) == 0
    first = model.read_text()
    distances, centre, period = (yaml.safe_load(first)[key] for key in ("distances", "centre", "period"))
    assert 0 <= period < 1  # of unit vectors
    assert len(centre) == 48 and 0 < np.abs(centre).max() < 1
    assert len(distances["matching"]) == 13 and len(distances["other"]) == 11
    for values in distances.values():
        assert values == sorted(values) and 0 <= values[0] and values[-1] <= 256
    # Random filters tell points apart: half of the matches are nearer than a thousandth of the others.
    assert distances["matching"][6] < distances["other"][2]
    assert FeatureNetwork(model).features().period == period
    # Another centre, other bits: a map of before is no longer its own.
    names = [FeatureNetwork(model).features().name]
    model.write_text(first.split("# Bits")[0])
    names.append(FeatureNetwork(model).features().name)
    assert names[0] != names[1]
    assert main(command) == 0
    assert model.read_text() == first, "measured with bits of before, or without: the same"
    assert main(command) == 0
    assert model.read_text() == first, "replaced, not added"
    assert yaml.safe_load(capsys.readouterr().out.split("# Bits")[1].split("\n", 1)[1])["distances"] == distances
    assert main(["features", str(recording), "--write"]) == 2


@needs_onnx
@pytest.mark.parametrize("change, what", [
    ({"output": {"kind": "words"}}, "output.kind"), ({"name": None}, "name"),
    ({"input": {"channels": 1}}, "input.size"), ({"output": {"kind": "cells", "cells": "x"}}, "output.cells"),
    ({"features": 0.5}, "features"), ({"distances": [1]}, "distances"), ({"file": "none.onnx"}, "none.onnx"),
    ({"reach": "far"}, "reach|far"), ({"period": "long"}, "long"), ({"period": 1e9}, "period"), ({"output": {"kind": "points", "keypoints": "cells", "scores": "cells"}},
                                      "keypoints"),
])
def test_wrong_models_are_refused_in_one_line(recording, tmp_path, capsys, change, what):
    import re
    import yaml
    model = write_cells_network(tmp_path)
    settings = {**yaml.safe_load(model.read_text()), **change}
    model.write_text(yaml.safe_dump({k: v for k, v in settings.items() if v is not None}))
    assert main(["run", str(recording), "--features", str(model), "--output", str(tmp_path / "o")]) == 2
    error = capsys.readouterr().err
    assert re.search(what, error) and error.count("\n") == 1 and str(tmp_path) in error, error


def test_options_need_the_model(recording, tmp_path, capsys):
    for option in (["--features-count", "100"], ["--features-weights", "x"], ["--features-threads", "2"]):
        assert main(["run", str(recording), *option, "--output", str(tmp_path / "o")]) == 2
        assert f"{option[0]} needs --features" in capsys.readouterr().err
