# SPDX-License-Identifier: BSD-3-Clause
"""Prior files, priors from memory, the distance model."""

import subprocess
import types
from pathlib import Path

import numpy as np
import pytest

import kys_slam
from conftest import BIN
from kys_slam import kysp
from kys_slam.drawing import encode_png
from test_recordings import OWN


def example(camera=None):
    rng = np.random.default_rng(7)
    cameras = []
    for side in range(2):
        segments = np.zeros(3, kysp.SEGMENT)
        segments["label"] = [2, 100, 130]
        segments["flags"] = [kysp.THING | kysp.DYNAMIC, 0, 0]
        segments["instance"] = np.arange(3) + side * kysp.RIGHT_INSTANCES
        segments["scale"] = [1e5, 0, 3e6]
        map_ = np.zeros((240, 320), np.uint16)
        map_[:120], map_[120:], map_[90:150, 200:260] = 3, 2, 1
        motion = kysp.MOTION[rng.integers(0, 256, (240, 320))]
        cameras.append(kys_slam.PriorCamera(segments, map_, motion))
    return kys_slam.PriorFrame("coco_panoptic_133", cameras,
                               camera.calibration_hash() if camera else 0, 5, True)


def test_files_are_those_of_the_numpy_module(tmp_path):
    path = tmp_path / "000001.kysp"
    kys_slam.write_prior(path, example())
    theirs, ours = kysp.read(path), kys_slam.read_prior(path)
    for a, b, given in zip(theirs.cameras, ours.cameras, example().cameras):
        assert np.array_equal(a.segments, b.segments)
        assert np.array_equal(a.segment_map, given.segment_map)
        assert np.array_equal(b.segment_map, given.segment_map)
        assert np.array_equal(a.motion, b.motion)
    assert ours.content_key == 5 and ours.has_motion
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(kys_slam.InputError, match="000001.kysp"):
        kys_slam.read_prior(path)
    with pytest.raises(kys_slam.InputError, match="none.kysp"):
        kys_slam.read_prior(tmp_path / "none.kysp")


@pytest.mark.parametrize("shares", [False, True])
def test_instances_of_both_cameras_stay_one(tmp_path, shares):
    path = tmp_path / "000001.kysp"
    frame = example()
    frame.shares_instances = shares
    kys_slam.write_prior(path, frame)
    assert kysp.read(path).shares_instances is shares
    again = kys_slam.read_prior(path)
    assert again.shares_instances is shares
    before = path.read_bytes()
    kys_slam.write_prior(path, again)
    assert path.read_bytes() == before


def test_priors_from_memory_equal_those_from_files(corridor, corridor_camera, tmp_path):
    frame = example(corridor_camera)
    for i in range(len(corridor)):
        kys_slam.write_prior(tmp_path / f"{i:06d}.kysp", frame)
    poses = []
    for folder in (None, tmp_path):
        slam = kys_slam.System(corridor_camera, {"orb.features": 600, "kys.mode": "kys"},
                               priors=folder)
        for i, (left, right, timestamp, _) in enumerate(corridor):
            report = slam.feed(left, right, timestamp, segments=None if folder else frame,
                               name=f"{i:06d}")
            assert report.prior_coverage == 1
        slam.finish()
        poses.append(slam.trajectory().poses)
    assert np.array_equal(*poses)


def test_masks_of_the_movers_equal_mode_mask(corridor, corridor_camera):
    frame = example(corridor_camera)
    masks = tuple((c.segment_map == 1).astype(np.uint8) for c in frame.cameras)
    results = []
    for options, given in (({"kys.mode": "mask"}, {"segments": frame}), ({}, {"masks": masks})):
        slam = kys_slam.System(corridor_camera, {"orb.features": 600, **options})
        masked = [slam.feed(left, right, t, **given).masked for left, right, t, _ in corridor]
        slam.finish()
        results.append((masked, slam.trajectory().poses))
    assert min(results[0][0]) > 0
    assert results[0][0] == results[1][0]
    assert np.array_equal(results[0][1], results[1][1])


def test_wrong_priors_raise(corridor, corridor_camera, tmp_path):
    left, right, *_ = corridor[0]
    slam = kys_slam.System(corridor_camera, {"kys.mode": "kys"})
    other = example()
    other.calibration_hash = 12345
    with pytest.raises(kys_slam.InputError, match="calibration"):
        slam.feed(left, right, 0.0, segments=other)
    other = example()
    other.cameras[0].segment_map[0, 0] = 9
    with pytest.raises(kys_slam.InputError):
        slam.feed(left, right, 0.0, segments=other)
    with pytest.raises(kys_slam.InputError, match="no prior files"):
        kys_slam.System(corridor_camera, priors=tmp_path)


def test_priors_from_class_maps():
    space = kys_slam.LabelSpace("coco_panoptic_133")
    person = space.ids[space.index_of("person")]
    classes = np.full((4, 6), 99999)
    classes[1:3, 1:5] = person
    instances = np.zeros((4, 6), int)
    instances[1:3, 1:3], instances[1:3, 3:5] = 11, 12
    frame = kys_slam.priors_from_labels(space, classes, classes, instances, instances, (12,))
    left, right = frame.cameras
    assert left.segment_map[0, 0] == 0 and len(left.segments) == 2
    assert set(left.segments["label"]) == {space.index_of("person")}
    assert list(left.segments["flags"] & kysp.DYNAMIC != 0) == [False, True]
    assert (right.segments["instance"] >= kysp.RIGHT_INSTANCES).all()
    kys_slam.priors.encode_prior(frame)
    for moving, judged in (((12,), True), ((), True), (None, False)):
        frame = kys_slam.priors_from_labels(space, classes, classes, instances, instances, moving)
        assert kysp.decode(kys_slam.priors.encode_prior(frame)).has_motion is judged
    assert not kys_slam.priors_from_labels(space, classes, classes).has_motion


def test_instances_that_no_file_can_hold_are_refused():
    space = kys_slam.LabelSpace("coco_panoptic_133")
    index = {name: i for i, name in enumerate(space.names)}
    person = np.full((4, 6), space.ids[index["person"]])
    sky = np.full((4, 6), space.ids[index["sky-other-merged"]])
    largest = kysp.RIGHT_INSTANCES - len(space.names) - 1
    for value, said in ((largest + 1, "instance"), (-1, "instance -1 is not"), (1.5, "whole numbers"),
                        (np.nan, "whole numbers"), (np.inf, "whole numbers"),
                        (np.uint64(1 << 63), "whole numbers")):
        with pytest.raises(kys_slam.InputError, match=said):
            kys_slam.priors_from_labels(space, person, person, np.full((4, 6), value))
    for classes, value in ((person, largest), (person, np.uint64(7)), (person, 7.0), (sky, -1)):
        ids = np.full((4, 6), value)
        frame = kys_slam.priors_from_labels(space, classes, classes, ids, ids)
        assert kysp.decode(kys_slam.priors.encode_prior(frame)).cameras[1].segment_map.all()
    many = np.arange(1, 257 * 256 + 1).reshape(256, 257)
    with pytest.raises(kys_slam.InputError, match="65535 segments"):
        kys_slam.priors_from_labels(space, np.full(many.shape, person[0, 0]), person, many)


def test_distance_model():
    rng = np.random.default_rng(3)
    a, b = (rng.integers(0, 256, (n, 32), np.uint8) for n in (5, 7))
    hamming = np.unpackbits(a[:, None] ^ b[None], axis=2).sum(2)
    space = kys_slam.LabelSpace("coco_panoptic_133")

    def priors(labels):
        n = len(labels)
        return kys_slam.Priors(np.array(labels, np.uint16), np.arange(n, dtype=np.int32),
                               np.zeros(n, np.float32), np.zeros(n, np.float32), np.zeros(n, bool))

    labels_a, labels_b = [0, 1, 2, 100, 65535], [0, 1, 2, 3, 100, 101, 65535]
    pa, pb = priors(labels_a), priors(labels_b)
    stock, tiers = kys_slam.DistanceModel("stock").distances(a, pa, b, pb)
    assert np.array_equal(stock, hamming) and (tiers == 3).all()
    semantic, _ = kys_slam.DistanceModel("semantic").distances(a, pa, b, pb)
    for i, la in enumerate(labels_a):  # Eq. 2
        for j, lb in enumerate(labels_b):
            d = hamming[i, j]
            s = 0 if 65535 in (la, lb) else space.table[la, lb]
            expected = d if 65535 in (la, lb) else 0.7 * d + 0.3 * s
            assert semantic[i, j] == pytest.approx(expected, rel=1e-5)
    with pytest.raises(kys_slam.InputError):
        kys_slam.DistanceModel("nonsense")
    with pytest.raises(kys_slam.InputError, match="one prior"):
        kys_slam.DistanceModel("stock").distances(a, pb, b, pb)


@pytest.mark.parametrize("shares", [False, True])
def test_the_picture_of_tiers_tells_those_of_the_matcher(shares, tmp_path, monkeypatch):
    """Stereo matches on one object, on two of a class, on two classes, on a mover, and without a prior."""
    pytest.importorskip("matplotlib")
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "tools" / "experiments")
    import tier_picture
    prior = example()
    prior.shares_instances = shares
    for camera in prior.cameras:
        camera.segments["label"] = [100, 100, 130]
        camera.motion[:] = 50  # beyond the gate of stereo
        camera.segment_map[:] = 0
        camera.segment_map[20:40, 100:], camera.segment_map[60:80, 100:] = 2, 3
        camera.segments["flags"][0] = kysp.DYNAMIC
        camera.segment_map[100:120] = 1
    prior.cameras[0].segment_map[60:70, 200:], prior.cameras[1].segment_map[60:70] = 2, 1
    prior.cameras[1].segments["flags"][0] = 0
    kys_slam.write_prior(tmp_path / "a.kysp", prior)
    camera = kys_slam.StereoCamera(320, 240, 200, 200, 160, 120, 0.5)
    points = np.array([[200, 30], [250, 65], [250, 64.5], [210, 75], [101, 70], [250, 110], [250, 200], [2, 25]],
                      np.float32)
    seen = types.SimpleNamespace(keypoints=points, depths=np.full(len(points), 100 / 5.0))  # 5 px
    ends, tiers = tier_picture.stereo_tiers(kys_slam, seen, types.SimpleNamespace(name="a"), camera,
                                            tmp_path, "kys")
    same = "same instance" if shares else "cross instance"
    assert np.allclose(ends[:, 0] - ends[:, 1], [5, 0])
    assert list(tiers) == [same, "cross instance", "cross instance", same, "bypassed", "gated", "bypassed",
                           "bypassed"]


GREY = np.array([[i, i, i, 255] for i in range(256)], np.uint8)


def write_pair(folder, corridor, left, right):
    for side, at in ((left, 0), (right, 1)):
        (folder / side).mkdir(parents=True)
        for i, shot in enumerate(corridor):
            (folder / side / f"{i:06d}.png").write_bytes(encode_png(shot[at], GREY))


def test_priors_of_the_other_camera_pair_are_refused(tmp_path, corridor, corridor_camera, capsys):
    """A KITTI folder with both pairs; the colour cameras' baseline differs, as KITTI's does."""
    from kys_slam import cli
    c = corridor_camera
    for pair in (("image_0", "image_1"), ("image_2", "image_3")):
        write_pair(tmp_path / "seq", corridor, *pair)
    rows = "".join(f"P{i}: {c.fx} 0 {c.cx} {shift} 0 {c.fy} {c.cy} 0 0 0 1 0\n" for i, shift in
                   enumerate((0, -c.fx * c.baseline, 15, 15 - c.fx * (c.baseline - 0.002))))
    (tmp_path / "seq" / "calib.txt").write_text(rows)
    (tmp_path / "seq" / "times.txt").write_text("".join(f"{s[2]}\n" for s in corridor))
    grey, colour = (kys_slam.open_sequence(tmp_path / "seq", pair=p) for p in ("grey", "colour"))
    assert kys_slam.open_sequence(tmp_path / "seq").camera == grey.camera != colour.camera
    classes = np.full((c.height, c.width), 3, np.int32)  # COCO's car
    space = kys_slam.LabelSpace("coco_panoptic_133")
    frame = kys_slam.priors_from_labels(space, classes, classes)
    frame.calibration_hash = colour.camera.calibration_hash()
    (tmp_path / "priors").mkdir()
    for i in range(len(corridor)):
        kys_slam.write_prior(tmp_path / "priors" / f"{i:06d}.kysp", frame)
    base = ["run", str(tmp_path / "seq"), "--priors", str(tmp_path / "priors"), "--quiet",
            "--set", "orb.features=600", "--output"]
    assert cli.main([*base, str(tmp_path / "a")]) == 2
    assert "camera pair (--pair)" in capsys.readouterr().err
    assert cli.main([*base, str(tmp_path / "b"), "--pair", "colour"]) == 0
    # Perception says of which images it was made.
    panoptic = tmp_path / "panoptic"
    panoptic.mkdir()
    (panoptic / "images.txt").write_text("image_2\n")
    builder = BIN / "build_priors"
    if not builder.exists():
        pytest.skip("build_priors is not built")
    done = subprocess.run([builder, tmp_path / "seq", "--panoptic-left", panoptic, "--output",
                           tmp_path / "built"], capture_output=True, text=True)
    assert done.returncode == 2
    assert "made of image_2, but image_0 is tracked" in done.stderr
    (panoptic / "images.txt").write_text("image_0\n")
    done = subprocess.run([builder, tmp_path / "seq", "--panoptic-left", panoptic, "--disparity",
                           panoptic, "--disparity-right", panoptic, "--output", tmp_path / "built"],
                          capture_output=True, text=True)
    assert done.returncode == 2
    assert "made of image_0, but image_1 is tracked" in done.stderr


def test_masks_with_a_list_of_classes_are_priors(tmp_path, corridor, corridor_camera):
    """A picture of instances with classes.txt does what the same class map does as prior files."""
    from kys_slam import cli
    from kys_slam.masks import MaskFolder
    c = corridor_camera
    write_pair(tmp_path, corridor, "left_images", "right_images")
    (tmp_path / "camera.yaml").write_text(OWN)
    values = np.zeros((c.height, c.width), np.uint8)
    values[30:100, 20:120], values[40:120, 200:300], values[0:20, 0:60] = 7, 60, 150
    for side in ("left", "right"):
        (tmp_path / "masks" / side).mkdir(parents=True)
        for i in range(len(corridor)):
            (tmp_path / "masks" / side / f"{i:06d}.png").write_bytes(encode_png(values, GREY))
    (tmp_path / "masks" / "classes.txt").write_text("1-50 car moving # vehicles\n\n60 person\n")
    masks = MaskFolder(tmp_path / "masks")
    pair = masks("000000")
    frame, rest = masks.priors(pair), masks.without_classes(pair)
    left = frame.cameras[0]
    at = lambda v, u: left.segments[left.segment_map[v, u] - 1] if left.segment_map[v, u] else None
    names = kys_slam.LabelSpace("coco_panoptic_133").names
    assert names[at(50, 50)["label"]] == "car" and at(50, 50)["flags"] & kysp.DYNAMIC
    assert names[at(60, 250)["label"]] == "person" and not at(60, 250)["flags"] & kysp.DYNAMIC
    assert at(10, 10) is None and rest[0][10, 10] == 150 and rest[0][50, 50] == 0
    assert frame.has_motion
    # A mover that is listed and one that is masked out: mode mask drops both.
    slam = kys_slam.System(c, {"orb.features": 600, "kys.mode": "mask"})
    for i, (l, r, time, _) in enumerate(corridor):
        pair = masks(f"{i:06d}")
        report = slam.feed(l, r, time, masks.priors(pair), masks.without_classes(pair))
    assert report.masked > 0 and report.prior_coverage > 0
    space = kys_slam.LabelSpace("coco_panoptic_133")
    classes = np.full(values.shape, -1)
    classes[values == 7], classes[values == 60] = (space.ids[names.index(n)] for n in ("car", "person"))
    instances = np.where(classes < 0, 0, values)
    (tmp_path / "priors").mkdir()
    for i in range(len(corridor)):
        kys_slam.write_prior(tmp_path / "priors" / f"{i:06d}.kysp", kys_slam.priors_from_labels(
            space, classes, classes, instances, instances, moving=(7,)))
    for side in ("left", "right"):  # masks alone: where no class is listed
        (tmp_path / "rest" / side).mkdir(parents=True)
        for i in range(len(corridor)):
            (tmp_path / "rest" / side / f"{i:06d}.png").write_bytes(
                encode_png(np.where(values == 150, values, 0).astype(np.uint8), GREY))
    base = ["run", str(tmp_path / "left_images"), str(tmp_path / "right_images"), "--calibration",
            str(tmp_path / "camera.yaml"), "--rate", "10", "--quiet", "--mode", "mask", "--set",
            "orb.features=600"]
    for out, given in (("a", ["--masks", "masks"]), ("b", ["--masks", "rest", "--priors", "priors"]),
                       ("c", ["--masks", "rest", "--mode", "stock"])):
        given = [word if word[:2] == "--" or word == "stock" else str(tmp_path / word) for word in given]
        assert cli.main([*base, *given, "--output", str(tmp_path / out)]) == 0
    paths = [(tmp_path / out / "trajectory.tum").read_bytes() for out in "abc"]
    assert paths[0] == paths[1] != paths[2]
    (tmp_path / "masks" / "classes.txt").write_text("1-50 car\n")
    assert not MaskFolder(tmp_path / "masks").priors(pair).has_motion
    for text, error in (("1-300 car\n", "range"), ("1 carr\n", "no class"),
                        ("1-9 car\n5 person\n", "twice")):
        (tmp_path / "masks" / "classes.txt").write_text(text)
        with pytest.raises(kys_slam.InputError, match=error):
            MaskFolder(tmp_path / "masks")
