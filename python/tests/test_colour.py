# SPDX-License-Identifier: BSD-3-Clause
"""Colour images for networks, of every kind of input; tracking sees grey ones."""

import dataclasses
import shutil
import sys

import numpy as np
import pytest

import kys_slam
from bags import write_bag
from conftest import ROOT
from kys_slam import recordings
from kys_slam.cli import main
from kys_slam.cli_input import open_recording
from kys_slam.cli_parser import make_parser
from kys_slam.colour import left_colour

cv2 = pytest.importorskip("cv2")

RED_BOX = slice(100, 160), slice(120, 200)
START = 10**18
FRAMES = 4
LENSES = {"straight": "[0, 0, 0, 0]", "bent": "[-0.05, 0.01, 0, 0]"}


def in_colour(grey):
    """(H, W, 3) RGB with a pure red box: grey level 76."""
    image = np.repeat(grey[:, :, None], 3, axis=2)
    image[RED_BOX] = 255, 0, 0
    return image


@pytest.fixture(scope="module")
def shots(corridor, tmp_path_factory):
    """(stamp ns, left file, right file) of colour images."""
    folder = tmp_path_factory.mktemp("colour")
    found = []
    for side in ("left", "right"):
        (folder / side).mkdir()
    for left, right, time, _ in corridor[:FRAMES]:
        stamp = START + int(round(time * 1e9))
        files = [folder / side / f"{stamp}.png" for side in ("left", "right")]
        for file, image in zip(files, (left, right)):
            cv2.imwrite(str(file), in_colour(image)[:, :, ::-1])
        found.append((stamp, *files))
    return found


@pytest.fixture(params=LENSES)
def calibration(tmp_path, request):
    side = f"{{width: 320, height: 240, fx: 250, fy: 250, cx: 159.5, cy: 119.5, model: radtan, " \
           f"distortion: {LENSES[request.param]}}}"
    file = tmp_path / "rig.yaml"
    file.write_text(f"left: {side}\nright: {side}\n"
                    "T_left_right: [1, 0, 0, 0.2, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n")
    return file


def expected(rig, file):
    """The rectified colour image of a file."""
    image = np.ascontiguousarray(cv2.imread(str(file))[:, :, ::-1])
    if rig.rectified():
        return image
    rectifier = kys_slam.StereoRectifier(rig)
    return np.stack([rectifier.rectify_left(np.ascontiguousarray(image[:, :, c])) for c in range(3)], -1)


def check(recording, shots, calibration):
    rig = kys_slam.read_stereo_rig([calibration])
    rig.set_image_size(320, 240)
    count = 0
    for frame, shot in zip(recording, shots):
        image = left_colour(recording, frame)
        assert np.array_equal(image, expected(rig, shot[1]))
        assert not np.array_equal(image[:, :, 0], image[:, :, 1])
        assert frame.left.ndim == 2
        count += 1
    assert count == FRAMES


def test_folders(shots, calibration):
    rig = kys_slam.read_stereo_rig([calibration])
    left, right = shots[0][1].parent, shots[0][2].parent
    check(kys_slam.open_image_pair(left, right, rig), shots, calibration)
    # Frames keep their numbers where a run begins later.
    check(kys_slam.open_image_pair(left, right, rig), shots, calibration)
    later = kys_slam.open_image_pair(left, right, rig, start=2)
    frame = next(later)
    assert np.array_equal(left_colour(later, frame), expected(rig, shots[2][1]))
    assert later.left_file(1) is None and later.left_file(FRAMES) is None


@pytest.mark.parametrize("encoding", ["rgb8", "png"])
def test_bags(shots, calibration, tmp_path, encoding):
    write_bag(tmp_path / "a.bag", "ros1", shots, encoding)
    recording = recordings.open_bag(tmp_path / "a.bag", kys_slam.read_stereo_rig([calibration]))
    recording.keep_colour = True
    check(recording, shots, calibration)


def test_grey_is_repeated(shots, calibration, tmp_path):
    write_bag(tmp_path / "a.bag", "ros1", shots, "mono8")
    rig = kys_slam.read_stereo_rig([calibration])
    recording = recordings.open_bag(tmp_path / "a.bag", rig)
    recording.keep_colour = True
    frame = next(iter(recording))
    assert frame.colour is None
    assert np.array_equal(left_colour(recording, frame), np.repeat(frame.left[:, :, None], 3, axis=2))


def test_nobody_pays_for_colour_that_is_not_asked_for(shots, calibration, tmp_path):
    write_bag(tmp_path / "a.bag", "ros1", shots, "rgb8")
    recording = recordings.open_bag(tmp_path / "a.bag", kys_slam.read_stereo_rig([calibration]))
    assert all(frame.colour is None for frame in recording)


def test_a_video_of_both_images(shots, calibration, tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "a.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 20, (640, 240))
    if not writer.isOpened():
        pytest.skip("OpenCV writes no such video")
    for _, left, right in shots:
        writer.write(np.hstack([cv2.imread(str(left)), cv2.imread(str(right))]))
    writer.release()
    rig = kys_slam.read_stereo_rig([calibration])
    recording = recordings.open_videos(tmp_path / "a.avi", None, rig)
    recording.keep_colour = True
    for frame, shot in zip(recording, shots):
        inner = left_colour(recording, frame)[120:140, 145:175].reshape(-1, 3).mean(axis=0)
        assert inner[0] > 200 and inner[1] < 60 and inner[2] < 60
        assert abs(float(frame.left[120:140, 145:175].mean()) - 76) < 12


@pytest.fixture
def kitti_folder(corridor, tmp_path):
    """KITTI odometry with both pairs: the grey one, and one in colour."""
    folder = tmp_path / "00"
    for name, side, coloured in (("image_0", 0, False), ("image_1", 1, False), ("image_2", 0, True),
                                 ("image_3", 1, True)):
        (folder / name).mkdir(parents=True)
        for i, shot in enumerate(corridor[:FRAMES]):
            image = in_colour(shot[side])[:, :, ::-1] if coloured else shot[side]
            cv2.imwrite(str(folder / name / f"{i:06d}.png"), image)
    row = "250 0 159.5 {} 0 250 119.5 0 0 0 1 0"
    (folder / "calib.txt").write_text("".join(f"P{k}: {row.format(-50 * (k % 2))}\n" for k in range(4)))
    (folder / "times.txt").write_text("".join(f"{shot[2]}\n" for shot in corridor[:FRAMES]))
    return folder


def test_the_pair_of_kitti_that_is_tracked(kitti_folder):
    for pair, red in (("grey", False), ("colour", True)):
        sequence = kys_slam.open_sequence(kitti_folder, pair=pair)
        image = left_colour(sequence, next(sequence))
        assert (image[130, 160].tolist() == [255, 0, 0]) == red


def test_a_network_has_the_colour_pair_and_stored_segments_have_theirs(kitti_folder, tmp_path):
    text = (kitti_folder / "calib.txt").read_text().splitlines()
    text[3] = text[3].replace("-50", "-51")  # as real ones, the pairs differ
    (kitti_folder / "calib.txt").write_text("\n".join(text) + "\n")
    hashes = {pair: kys_slam.open_sequence(kitti_folder, pair=pair).camera.calibration_hash()
              for pair in ("grey", "colour")}

    def tracked(*options):
        args = make_parser().parse_args(["run", str(kitti_folder), *options])
        return open_recording(args).camera.calibration_hash()

    assert tracked() == hashes["grey"] != hashes["colour"]
    assert tracked("--segment", "network.yaml") == hashes["colour"]
    assert tracked("--segment", "network.yaml", "--pair", "grey") == hashes["grey"]
    for pair, value in hashes.items():
        folder = tmp_path / pair
        folder.mkdir()
        labels = np.zeros((240, 320), int)
        frame = kys_slam.priors_from_labels(kys_slam.LabelSpace("cityscapes_19"), labels)
        kys_slam.write_prior(folder / "000000.kysp", dataclasses.replace(frame, calibration_hash=value))
        assert tracked("--segment", str(folder)) == value
    shutil.rmtree(kitti_folder / "image_3")
    assert tracked("--segment", "network.yaml") == hashes["grey"]


def test_the_network_of_a_run_sees_colour(shots, calibration, tmp_path):
    """A tiny network that takes bright red for a car: the box is one by its red channel alone."""
    pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    sys.path.insert(0, str(ROOT / "tests" / "priors"))
    from onnx_support import write_network
    model = write_network(tmp_path, scale=30)
    space = kys_slam.LabelSpace("cityscapes_19")
    car = space.names.index("car")
    run = ["run", str(shots[0][1].parent), str(shots[0][2].parent), "--calibration", str(calibration),
           "--segment", str(model), "--segment-provider", "cpu", "--output", str(tmp_path / "run"), "--quiet",
           "--no-check", "--save-priors", str(tmp_path / "priors")]
    main(run)
    files = sorted((tmp_path / "priors").glob("*.kysp"))
    assert len(files) == FRAMES
    for file in files:
        camera = kys_slam.read_prior(file).cameras[0]
        at_box = camera.segment_map[130, 160]
        assert at_box > 0 and camera.segments["label"][at_box - 1] == car


def test_a_provider_that_is_not_there_ends_with_one_line(shots, calibration, tmp_path, capfd):
    pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    sys.path.insert(0, str(ROOT / "tests" / "priors"))
    from onnx_support import write_network
    run = ["run", str(shots[0][1].parent), str(shots[0][2].parent), "--calibration", str(calibration),
           "--output", str(tmp_path / "run"), "--quiet"]
    assert main([*run, "--segment", str(write_network(tmp_path)), "--segment-provider", "none"]) == 2
    error = capfd.readouterr().err
    assert "provider 'none' is not known; this ONNX Runtime has: cpu" in error and error.count("\n") == 1
    assert main([*run, "--segment-provider", "cpu"]) == 2
    assert "--segment-provider needs --segment" in capfd.readouterr().err
