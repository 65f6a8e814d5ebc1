# SPDX-License-Identifier: BSD-3-Clause
"""Recordings as others make them: what is wrong is told in the first frames, what is right just runs."""

import json
import struct

import numpy as np
import pytest

import kys_slam
from bags import INFO, ros_camera_info, ros_header
from kys_slam import cli, recordings
from kys_slam.demo import CAMERA
from test_recordings import write_video

BASELINE, FX = CAMERA["baseline"], CAMERA["fx"]


def camera_info(side, **changes):
    """camera_info of the corridor's cameras."""
    P = np.array([[FX, 0, CAMERA["cx"], -FX * BASELINE * side], [0, CAMERA["fy"], CAMERA["cy"], 0],
                  [0, 0, 1, 0]])
    info = {"width": CAMERA["width"], "height": CAMERA["height"], "distortion_model": "plumb_bob",
            "D": [0.0] * 5, "K": P[:, :3].ravel(), "R": np.eye(3).ravel(), "P": P.ravel()}
    return {**info, **changes}


def write_bag(path, corridor, infos, pixels=lambda image: image, encoding="mono8", late=0, name="image_rect",
              width=None):
    """infos: per message, a pair of camera_info, the last one for all that follow. late: ns."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(path) as writer:
        topics = [[writer.add_connection(f"/stereo/{side}/{topic}", kind, typestore=store)
                   for topic, kind in ((name, "sensor_msgs/msg/Image"), ("camera_info", INFO))]
                  for side in ("left", "right")]
        for i, (left, right, time, _) in enumerate(corridor):
            for side, image in enumerate((left, right)):
                ns = int(round(time * 1e9)) + 10**18 + late * side
                data = pixels(image)
                message = store.types["sensor_msgs/msg/Image"](
                    ros_header(store.types, ns, True), data.shape[0], width or data.shape[1], encoding, 0,
                    data.strides[0], np.ascontiguousarray(data).view(np.uint8).ravel())
                given = infos[min(i, len(infos) - 1)][side]
                info = (ros_camera_info(store, given, ns, True),) if given else ()
                for connection, m in zip(topics[side], (message, *info)):
                    writer.write(connection, ns, store.serialize_ros1(m, m.__msgtype__))
    return path


@pytest.fixture
def bag(tmp_path, corridor):
    def make(*infos, **options):
        path = tmp_path / "c.bag"
        path.unlink(missing_ok=True)
        return write_bag(path, corridor, infos or [(camera_info(0), camera_info(1))], **options)
    return make


def both(**changes):
    return camera_info(0, **changes), camera_info(1, **changes)


def opened(path):
    return recordings.open_bag(path).camera


def refused(path):
    with pytest.raises(kys_slam.InputError) as told:
        recordings.open_bag(path)
    return str(told.value)


# camera_info

def full_sensor(x, y, scale):
    """camera_info of a sensor of which the corridor's images are a part, or binned."""
    infos = []
    for side in (0, 1):
        P = camera_info(side)["P"].reshape(3, 4).copy()
        P[0] *= scale
        P[1] *= scale
        P[0, 2] += x
        P[1, 2] += y
        infos.append({"K": P[:, :3].ravel(), "P": P.ravel()})
    return infos


def with_numbers(infos, **changes):
    return tuple(camera_info(side, **numbers, **changes) for side, numbers in enumerate(infos))


def assert_corridor(camera):
    for key in ("width", "height", "fx", "cx", "cy", "baseline"):
        assert getattr(camera, key) == pytest.approx(CAMERA[key], abs=1e-9), key


def test_region_of_interest_and_binning(bag):
    w, h = CAMERA["width"], CAMERA["height"]
    roi = [200, 160, w, h]
    cropped = full_sensor(200, 160, 1)
    assert_corridor(opened(bag(with_numbers(cropped, width=1000, height=800, roi=roi))))
    binned = full_sensor(0, 0, 2)
    assert_corridor(opened(bag(with_numbers(binned, width=2 * w, height=2 * h, binning_x=2, binning_y=2))))
    # Drivers that state the size of their images: with the sensor's K, and with that of the images.
    assert_corridor(opened(bag(with_numbers(cropped, roi=roi))))
    assert_corridor(opened(bag(both(roi=roi))))
    assert_corridor(opened(bag(with_numbers(binned, binning_x=2, binning_y=2))))
    # A small offset does not show in the principal point.
    said = refused(bag(with_numbers(full_sensor(10, 8, 1), roi=[10, 8, w, h])))
    assert "region of interest" in said and "--calibration" in said
    assert "out of range" in refused(bag(both(roi=[2**31, 0, w, h])))
    # A size that is of something else.
    said = refused(bag(both(width=1000, height=800)))
    assert "1000x800" in said and f"{w}x{h}" in said


def test_region_of_interest_in_files(tmp_path):
    """Messages as `ros2 topic echo` prints them."""
    w, h = CAMERA["width"], CAMERA["height"]
    files = []
    for side, numbers in enumerate(full_sensor(200, 160, 1)):
        info = camera_info(side, **numbers)
        lists = "".join(f"{key.lower()}: {list(map(float, info[key]))}\n" for key in "DKRP")
        files.append(tmp_path / f"{side}.yaml")
        files[-1].write_text(f"height: 800\nwidth: 1000\ndistortion_model: plumb_bob\n{lists}"
                             "binning_x: 0\nbinning_y: 0\nroi:\n  x_offset: 200\n  y_offset: 160\n"
                             f"  height: {h}\n  width: {w}\n  do_rectify: false\n")
    rig = kys_slam.read_stereo_rig(files)
    rig.set_image_size(w, h)
    assert_corridor(rig.rectified())


def test_rectified_images_of_fisheye_cameras(bag):
    assert_corridor(opened(bag(both(distortion_model="equidistant", D=[0.1, 0.0, 0.0, 0.0]))))


@pytest.mark.parametrize("model, D", (("rational_polynomial", [0.05, 0, 0, 0, 0, 0.01] + [0.0] * 8),
                                      ("plumb_bob", [0.05] + [0.0] * 13), ("none", []),
                                      ("plumb_bob", [0.0] * 14),
                                      ("equidistant", [0.1, 0.01, 0, 0, 0])))
def test_lenses_of_raw_images(bag, model, D):
    camera = opened(bag(both(distortion_model=model, D=D), name="image_raw"))
    assert camera.baseline == pytest.approx(BASELINE, rel=1e-6)
    if any(D):
        assert camera.fx != FX
    else:
        assert_corridor(camera)


def test_messages_before_the_calibration_and_without_one(bag):
    zeros = both(K=[0.0] * 9, P=[0.0] * 12, R=[0.0] * 9)
    assert_corridor(opened(bag(zeros, zeros, both())))
    said = refused(bag(zeros))
    assert "all zeros" in said and "--calibration FILE" in said


def test_baseline_in_metres_or_millimetres(bag):
    def with_shift(shift):
        right = camera_info(1)
        right["P"] = right["P"].copy()
        right["P"][3] = shift
        return camera_info(0), right

    said = refused(bag(with_shift(-BASELINE)))
    assert "P[3]" in said and "in m" in said and "--calibration FILE" in said
    said = refused(bag(with_shift(-1000 * FX * BASELINE)))
    assert f"{1000 * BASELINE:g} mm are {BASELINE:g} m" in said and "--calibration-unit" not in said


# 16 bits

def trajectory_of(path, tmp_path):
    out = tmp_path / "out"
    assert cli.main(["run", str(path), "--output", str(out), "--overwrite", "--quiet"]) == 0
    return np.loadtxt(out / "trajectory.tum"), json.loads((out / "summary.json").read_text())


def test_bags_of_10_and_12_bits(bag, tmp_path, capsys):
    reference, _ = trajectory_of(bag(), tmp_path)
    for bits in (10, 12):
        path = bag(pixels=lambda image: image.astype(np.uint16) << (bits - 8), encoding="mono16")
        found, summary = trajectory_of(path, tmp_path)
        assert np.array_equal(found, reference)
        assert capsys.readouterr().err.count(f"{bits} bits") == 1
        assert len([w for w in summary["warnings"] if f"{bits} bits" in w]) == 1
    big = bag(pixels=lambda image: (image.astype(np.uint16) << 2).astype(">u2"), encoding="mono16")
    assert big.exists()


def test_bags_of_usb_cameras_and_with_one_camera_info(bag, tmp_path, capsys):
    """Luma is every second byte; the trajectory is that of the grey images."""
    results = {}
    for encoding, luma in (("mono8", None), ("yuv422_yuy2", 0), ("yuv422", 1)):
        def pixels(image):
            if luma is None:
                return image
            both = np.full(image.shape + (2,), 90, np.uint8)
            both[:, :, luma] = image
            return both.reshape(image.shape[0], -1)
        path = bag(pixels=pixels, encoding=encoding, width=CAMERA["width"])
        assert cli.main(["run", str(path), "--output", str(tmp_path / encoding), "--quiet",
                         "--set", "orb.features=600"]) == 0
        results[encoding] = (tmp_path / encoding / "trajectory.tum").read_bytes()
    assert len(set(results.values())) == 1 and len(results["mono8"].splitlines()) == 12
    assert cli.main(["run", str(bag((camera_info(0), None))), "--quiet"]) == 2
    said = capsys.readouterr().err
    assert "no camera_info beside /stereo/right/image_rect;" in said


def test_arrays_of_12_bits(corridor, corridor_camera, caplog):
    poses = []
    for shift in (0, 4):
        slam = kys_slam.System(corridor_camera, {"orb.features": 600}, "sequential")
        for left, right, time, _ in corridor:
            if shift:
                left, right = (image.astype(np.uint16) << shift for image in (left, right))
            assert not slam.feed(left, right, time).lost
        slam.finish()
        poses.append(slam.trajectory().poses)
    assert np.array_equal(*poses)
    assert caplog.text.count("12 bits") == 1
    deep = corridor[0][0].astype(np.uint16) << 2
    assert kys_slam.used_bits(deep) == 10
    assert np.array_equal(kys_slam.to_gray(deep, bits=10), corridor[0][0])


# Times

def boxes(data, begin, end):
    while begin + 8 <= end:
        size, kind = struct.unpack(">I4s", data[begin:begin + 8])
        yield kind, begin, begin + size
        begin += size


def set_frame_times(path, seconds):
    """Rewrites how long the frames of an MP4 last."""
    data = bytearray(path.read_bytes().replace(b"edts", b"free"))
    begin, end, parents = 0, len(data), []
    for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts"):
        inside = {kind: (a, b) for kind, a, b in boxes(data, begin, end)}
        if name == b"minf":
            scale = struct.unpack(">I", data[inside[b"mdhd"][0] + 20:inside[b"mdhd"][0] + 24])[0]
        at, end = inside[name]
        parents.append(at)
        begin = at + 8
    table = b"".join(struct.pack(">II", 1, round(s * scale)) for s in seconds)
    table = struct.pack(">I4sII", 16 + len(table), b"stts", 0, len(seconds)) + table
    grown = len(table) - (end - at)
    data[at:end] = table
    for parent in parents[:-1]:
        size, = struct.unpack(">I", data[parent:parent + 4])
        data[parent:parent + 4] = struct.pack(">I", size + grown)
    path.write_bytes(data)


def write_mp4(path, images, seconds=None):
    cv2 = pytest.importorskip("cv2")
    height, width = images[0].shape
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 10, (width, height))
    if not video.isOpened():
        pytest.skip("this OpenCV writes no MP4")
    for image in images:
        video.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    video.release()
    if seconds is not None:
        set_frame_times(path, seconds)


@pytest.fixture
def rig(tmp_path):
    lens = (f"{{width: {CAMERA['width']}, height: {CAMERA['height']}, fx: {FX}, fy: {FX}, "
            f"cx: {CAMERA['cx']}, cy: {CAMERA['cy']}}}")
    (tmp_path / "rig.yaml").write_text(
        f"left: {lens}\nright: {lens}\n"
        f"T_left_right: [1, 0, 0, {BASELINE}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n")
    return kys_slam.read_stereo_rig([tmp_path / "rig.yaml"])


def test_times_of_a_video_of_variable_rate(tmp_path, corridor, rig):
    lasts = [0.1] * 4 + [0.3] + [0.1] * 4 + [0.5] + [0.1] * 2
    times = np.concatenate([[0], np.cumsum(lasts)[:-1]])
    for name, side in (("left.mp4", 0), ("right.mp4", 1)):
        write_mp4(tmp_path / name, [c[side] for c in corridor], lasts)
    frames = list(recordings.open_videos(tmp_path / "left.mp4", tmp_path / "right.mp4", rig))
    assert [f.timestamp for f in frames] == pytest.approx(times, abs=2e-3)
    by_rate = list(recordings.open_videos(tmp_path / "left.mp4", tmp_path / "right.mp4", rig, rate=20))
    assert [f.timestamp for f in by_rate] == pytest.approx(np.arange(12) / 20)


def test_videos_that_lack_frames_are_paired_by_time(tmp_path, corridor, rig):
    def write(name, side, lost):
        kept = [i for i in range(12) if i not in lost]
        write_mp4(tmp_path / name, [np.full_like(corridor[0][0], 20 * i) for i in kept],
                  0.1 * np.diff([*kept, 12]))
    write("left.mp4", 0, (3,))
    write("right.mp4", 1, (6, 7))
    recording = recordings.open_videos(tmp_path / "left.mp4", tmp_path / "right.mp4", rig)
    frames = list(recording)
    assert [round(f.timestamp, 3) for f in frames] == [0, 0.1, 0.2, 0.4, 0.5, 0.8, 0.9, 1.0, 1.1]
    for frame in frames:
        for image in (frame.left, frame.right):
            assert np.median(image) == pytest.approx(200 * frame.timestamp, abs=5)
    assert recording.counts["unmatched left"] == 2 and recording.counts["unmatched right"] == 1


def test_videos_of_constant_rate_have_the_times_of_the_rate(tmp_path, corridor, rig):
    for name in ("left.avi", "right.avi"):
        write_video(tmp_path / name, [c[0] for c in corridor])
    frames = list(recordings.open_videos(tmp_path / "left.avi", tmp_path / "right.avi", rig))
    assert [f.timestamp for f in frames] == [i / 10 for i in range(12)]


# Pairs

def test_bags_without_a_pair_say_how_near_it_is(bag):
    said = refused(bag(late=25_000_000))
    for part in ("12 images of /stereo/left/image_rect", "12 of /stereo/right/image_rect", "0.025 s apart",
                 "--tolerance"):
        assert part in said
    assert len(list(recordings.open_bag(bag(late=25_000_000), tolerance=0.03))) == 12


def test_one_topic_twice_is_refused(bag, corridor, tmp_path, capsys):
    """Also where the two cameras are rectified differently."""
    same = [(left, left, time, position) for left, _, time, position in corridor]
    turned = camera_info(1, D=[-0.1, 0.01, 0, 0, 0])
    for name, right in (("image_rect", camera_info(1)), ("image_raw", turned)):
        infos = [(camera_info(0, D=[0.05, 0, 0, 0, 0]), right)]
        path = tmp_path / "same.bag"
        path.unlink(missing_ok=True)
        write_bag(path, same, infos, name=name)
        assert cli.main(["run", str(path), "--output", str(tmp_path / "out"), "--overwrite", "--quiet"]) == 2
        said = capsys.readouterr().err
        assert "same image" in said and "two cameras" in said
    recording = recordings.open_bag(bag(both(D=[0.05, 0, 0, 0, 0]), name="image_raw"))
    assert not any(kys_slam._core.is_same_image(f.left, f.right) for f in recording)


# Masks

def write_folders(tmp_path, corridor):
    cv2 = pytest.importorskip("cv2")
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
    for i, (left, right, *_) in enumerate(corridor):
        cv2.imwrite(str(tmp_path / "left" / f"{i}.png"), left)
        cv2.imwrite(str(tmp_path / "right" / f"{i}.png"), right)
    return ["run", str(tmp_path), "--calibration", str(tmp_path / "rig.yaml"), "--rate", "10", "--quiet",
            "--overwrite", "--output", str(tmp_path / "out")]


def masked(tmp_path):
    lines = (tmp_path / "out" / "frames.csv").read_text().splitlines()
    column = lines[0].split(",").index("masked")
    return [int(line.split(",")[column]) for line in lines[1:]]


def test_one_mask_of_all_frames(tmp_path, corridor, rig, capsys):
    cv2 = pytest.importorskip("cv2")
    call = write_folders(tmp_path, corridor)
    mask = np.zeros((CAMERA["height"], CAMERA["width"]), np.uint8)
    mask[2 * mask.shape[0] // 3:] = 255
    file = tmp_path / "mask.png"
    cv2.imwrite(str(file), mask)
    assert cli.main([*call, "--mask", str(file)]) == 0
    assert min(masked(tmp_path)) > 0 and "warning" not in capsys.readouterr().err
    one = masked(tmp_path)
    assert cli.main([*call, "--mask", str(file), str(file)]) == 0
    assert all(a < b for a, b in zip(one, masked(tmp_path)))
    cv2.imwrite(str(file), np.where(mask[::-1] == 0, 255, 0).astype(np.uint8)[:, ::-1] | (255 - mask))
    cli.main([*call, "--mask", str(file)])
    assert capsys.readouterr().err.count("mask inverted?") == 1
    cv2.imwrite(str(file), mask[1:])
    assert cli.main([*call, "--mask", str(file)]) == 2
    assert "mask.png" in capsys.readouterr().err
    assert cli.main([*call, "--mask", "a", "b", "c"]) == 2


def test_masks_of_16_bits_count_small_numbers(corridor, corridor_camera):
    slam = kys_slam.System(corridor_camera, {"orb.features": 600})
    mask = np.full(corridor[0][0].shape, 3, np.uint16)
    report = slam.feed(*corridor[0][:3], masks=(mask, None))
    assert report.lost and report.reason == "masks leave no corners of the image"
    assert "inverted" in report.warning


# Commands

def test_calibrations_without_a_size_are_shown(tmp_path, capsys):
    K = f"[{FX}, 0, {CAMERA['cx']}, 0, {FX}, {CAMERA['cy']}, 0, 0, 1]"
    (tmp_path / "cv.yaml").write_text(
        f"M1: {K}\nD1: [0, 0, 0, 0, 0]\nM2: {K}\nD2: [0, 0, 0, 0, 0]\n"
        f"R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT: [-{BASELINE}, 0, 0]\n")
    assert cli.main(["calibrate", str(tmp_path / "cv.yaml")]) == 0
    printed = capsys.readouterr().out
    assert f"{BASELINE:.5f} m apart" in printed and "--size" in printed
    assert cli.main(["calibrate", str(tmp_path / "cv.yaml"), "--calibration-unit", "1000"]) == 2
    assert "mm are" in capsys.readouterr().err
    assert cli.main(["calibrate", str(tmp_path / "cv.yaml"), "--output", str(tmp_path / "o.yaml")]) == 2
    assert "--size" in capsys.readouterr().err


def test_pictures_go_to_their_run(tmp_path, corridor, corridor_camera, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    slam = kys_slam.System(corridor_camera, {"orb.features": 600})
    for left, right, time, _ in corridor:
        slam.feed(left, right, time)
    slam.finish()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    slam.write_run(tmp_path / "run", "corridor")
    for command, name in (("plot", "paths.png"), ("report", "report.html")):
        assert cli.main([command, str(tmp_path / "run")]) == 0
        assert (tmp_path / "run" / name).exists() and not list(elsewhere.iterdir())
        assert str(tmp_path / "run" / name) in capsys.readouterr().out
    times, poses = kys_slam.read_tum(tmp_path / "run" / "trajectory.tum")
    kys_slam.write_tum(tmp_path / "later.tum", times + 100, poses)
    assert cli.main(["evaluate", str(tmp_path / "run"), "--reference", str(tmp_path / "later.tum")]) == 2
    said = capsys.readouterr().err
    assert "0.000 to 1.100 s" in said and "100.000 to 101.100 s" in said


def test_a_recording_in_pieces_says_so(tmp_path, corridor, corridor_camera):
    """Three places one after the other: the same corridor, upside down, in negative."""
    slam = kys_slam.System(corridor_camera, {"orb.features": 600, "relocalization.patience": 1})
    views = (lambda left, right: (left, right), lambda left, right: (left[::-1], right[::-1]),
             lambda left, right: (255 - left, 255 - right))
    for i in range(12):
        left, right = views[i // 4](*corridor[i % 4][:2])
        slam.feed(np.ascontiguousarray(left), np.ascontiguousarray(right), 0.1 * i)
    slam.finish()
    result = slam.write_run(tmp_path / "run", "pieces")
    assert (result["connected"], result["tracked"]) == (4, 12)
    assert "4 of 12 frames connected" in result["failure"] and "3 sub-maps" in result["failure"]
    assert len(list((tmp_path / "run").glob("submap_*.tum"))) == 2
    pytest.importorskip("matplotlib")
    assert cli.main(["report", str(tmp_path / "run")]) == 0
    assert "12 of 12, 4 connected, 3 sub-maps" in (tmp_path / "run" / "report.html").read_text()


def test_loose_images_and_units_of_a_reference(tmp_path, corridor, corridor_camera, capsys):
    cv2 = pytest.importorskip("cv2")
    for i, (left, right, _, _) in enumerate(corridor[:2]):
        for folder, name, image in (("one", f"left_{i}", left), ("one", f"right_{i}", right),
                                    ("both", f"{i}", np.hstack([left, right]))):
            (tmp_path / folder).mkdir(exist_ok=True)
            cv2.imwrite(str(tmp_path / folder / f"{name}.png"), image)
    for folder, words in (("one", "folder left"), ("both", "LEFT and RIGHT")):
        assert cli.main(["run", str(tmp_path / folder), "--rate", "10"]) == 2
        assert words in capsys.readouterr().err
    times, poses = np.arange(5.0), np.tile(np.eye(4), (5, 1, 1))
    poses[:, 0, 3] = times
    kys_slam.write_tum(tmp_path / "m.tum", times, poses)
    poses[:, 0, 3] *= 1000
    kys_slam.write_tum(tmp_path / "mm.tum", times, poses)
    assert cli.main(["evaluate", str(tmp_path / "m.tum"), "--reference", str(tmp_path / "mm.tum")]) == 0
    assert "1e+03 times as long" in capsys.readouterr().out
