# SPDX-License-Identifier: BSD-3-Clause
"""Folders, videos and bags give what the sequence they were made of gives."""

import json
import shutil
import threading

import numpy as np
import pytest

import kys_slam
from bags import write_bag
from conftest import run_program
from kys_slam import cli, recordings

FRAMES = 30


def read_rows(path):
    rows = [line.split(",") for line in path.read_text().splitlines() if line[0] != "#"]
    return [(int(stamp), name.strip()) for stamp, name in rows][:FRAMES]


@pytest.fixture(scope="session")
def shots(euroc):
    """[(stamp ns, left path, right path)] of the EuRoC excerpt."""
    cams = [euroc / "mav0" / cam for cam in ("cam0", "cam1")]
    left, right = (read_rows(cam / "data.csv") for cam in cams)
    assert [s for s, _ in left] == [s for s, _ in right]
    return [(stamp, cams[0] / "data" / a, cams[1] / "data" / b)
            for (stamp, a), (_, b) in zip(left, right)]


def sensor(euroc, cam):
    """Calibration of one camera: (K 4, distortion 4, T_BS)."""
    yaml = pytest.importorskip("yaml")
    d = yaml.safe_load((euroc / "mav0" / cam / "sensor.yaml").read_text().replace("%YAML:1.0", ""))
    return (d["intrinsics"], d["distortion_coefficients"],
            np.array(d["T_BS"]["data"]).reshape(4, 4))


@pytest.fixture(scope="session")
def camchain(euroc, tmp_path_factory):
    """The excerpt's calibration as Kalibr writes it."""
    text = ""
    cameras = [sensor(euroc, cam) for cam in ("cam0", "cam1")]
    for i, (k, d, _) in enumerate(cameras):
        text += (f"cam{i}:\n  camera_model: pinhole\n  distortion_model: radtan\n"
                 f"  intrinsics: {k}\n  distortion_coeffs: {d}\n  resolution: [752, 480]\n")
    T_cam_imu = np.linalg.inv(cameras[0][2])
    T = np.linalg.inv(cameras[1][2]) @ cameras[0][2]
    text += "  T_cn_cnm1: " + str(T.tolist()) + "\n"
    text = text.replace("cam0:\n", "cam0:\n  T_cam_imu: " + str(T_cam_imu.tolist()) + "\n")
    path = tmp_path_factory.mktemp("calibration") / "camchain.yaml"
    path.write_text(text)
    return path


def run(tmp_path, *arguments):
    """kys-slam run; trajectory.tum."""
    out = tmp_path / "run"
    assert cli.main(["run", *map(str, arguments), "--output", str(out), "--quiet",
                     "--overwrite"]) == 0
    return np.loadtxt(out / "trajectory.tum"), (out / "trajectory.tum").read_bytes()


def test_sequence_folder(euroc, euroc_tum, tmp_path):
    assert run(tmp_path, euroc, "--frames", FRAMES)[1] == euroc_tum


def test_two_folders(shots, camchain, euroc_tum, tmp_path):
    for side, at in (("left", 1), ("right", 2)):
        (tmp_path / side).mkdir()
        for shot in shots:
            (tmp_path / side / f"{shot[0]}.png").symlink_to(shot[at])
    args = (tmp_path / "left", tmp_path / "right", "--calibration", camchain)
    assert run(tmp_path, *args)[1] == euroc_tum
    assert run(tmp_path, tmp_path, "--calibration", camchain)[1] == euroc_tum


def test_tum_vi_layout(shots, camchain, euroc_tum, tmp_path):
    for cam, at in (("cam0", 1), ("cam1", 2)):
        data = tmp_path / "room1" / "mav0" / cam / "data"
        data.mkdir(parents=True)
        for shot in shots:
            (data / f"{shot[0]}.png").symlink_to(shot[at])
        (data.parent / "data.csv").write_text(
            "#timestamp [ns],filename\n" + "".join(f"{s},{s}.png\n" for s, *_ in shots))
    (tmp_path / "room1" / "dso").mkdir()
    shutil.copy(camchain, tmp_path / "room1" / "dso" / "camchain.yaml")
    assert kys_slam.open_sequence(tmp_path / "room1").layout == "TUM-VI"
    assert run(tmp_path, tmp_path / "room1")[1] == euroc_tum


@pytest.mark.parametrize("kind, encoding", [("ros1", "mono8"), ("ros2", "png"), ("mcap", "mono8"),
                                            ("ros2", "bgr8")])
def test_bags(shots, camchain, euroc_tum, tmp_path, kind, encoding):
    bag = tmp_path / ("drone.bag" if kind == "ros1" else "drone")
    write_bag(bag, kind, shots, encoding)
    assert run(tmp_path, bag, "--calibration", camchain)[1] == euroc_tum


def test_bag_with_jitter_and_loss(shots, camchain, tmp_path):
    rng = np.random.default_rng(11)
    jitter = rng.integers(0, 8_000_000, FRAMES)
    lost = rng.random((FRAMES, 2)) < 0.1
    bag = tmp_path / "lossy.bag"
    write_bag(bag, "ros1", shots, "mono8", lambda i, side: lost[i, side], lambda i: jitter[i])
    rig = kys_slam.read_stereo_rig([camchain])
    recording = recordings.open_bag(bag, rig)
    names = [frame.name for frame in recording]
    expected = [str(shots[i][0]) for i in range(FRAMES) if not lost[i].any()]
    assert names == expected
    assert recording.counts["unmatched left"] == np.count_nonzero(~lost[:, 0] & lost[:, 1])
    assert recording.counts["unmatched right"] == np.count_nonzero(lost[:, 0] & ~lost[:, 1])


def test_bag_camera_info(tmp_path, corridor):
    """camera_info topics are found; a corridor that is rectified already stays as it is."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS1_NOETIC)
    t = store.types
    with Writer(tmp_path / "c.bag") as writer:
        images = [writer.add_connection(f"/stereo/{s}/image_rect", "sensor_msgs/msg/Image",
                                        typestore=store) for s in ("left", "right")]
        infos = [writer.add_connection(f"/stereo/{s}/camera_info", "sensor_msgs/msg/CameraInfo",
                                       typestore=store) for s in ("left", "right")]
        for i, (left, right, time, _) in enumerate(corridor):
            ns = int(round(time * 1e9)) + 10**18
            header = t["std_msgs/msg/Header"](
                seq=i, stamp=t["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9),
                frame_id="")
            for side, image in enumerate((left, right)):
                P = np.array([250.0, 0, 159.5, -250 * 0.2 * side, 0, 250, 119.5, 0, 0, 0, 1, 0])
                info = t["sensor_msgs/msg/CameraInfo"](
                    header=header, height=240, width=320, distortion_model="plumb_bob",
                    D=np.zeros(5), K=P.reshape(3, 4)[:, :3].ravel().copy(), R=np.eye(3).ravel(),
                    P=P, binning_x=0, binning_y=0,
                    roi=t["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False))
                message = t["sensor_msgs/msg/Image"](header, 240, 320, "mono8", 0, 320,
                                                     image.ravel())
                writer.write(infos[side], ns, store.serialize_ros1(info, info.__msgtype__))
                writer.write(images[side], ns, store.serialize_ros1(message, message.__msgtype__))
    recording = recordings.open_bag(tmp_path / "c.bag")
    assert recording.camera.baseline == pytest.approx(0.2) and recording.camera.fx == 250
    for frame, (left, right, *_) in zip(recording, corridor):
        assert np.array_equal(frame.left, left) and np.array_equal(frame.right, right)
    with pytest.raises(kys_slam.InputError, match="/stereo/left/image_rect"):
        recordings.open_bag(tmp_path / "c.bag", topics=("/a", "/b"))


def test_pairs_by_time():
    ms = 1_000_000
    stream = [(0, 0, "l0"), (1, 2 * ms, "r0"), (0, 50 * ms, "l1"), (1, 58 * ms, "r1"),
              (1, 101 * ms, "r2"), (0, 150 * ms, "l3"), (1, 153 * ms, "r3"), (0, 140 * ms, "late")]
    counts = {}
    pairs = list(recordings.pair_by_time(iter(stream), 0.01, counts))
    assert pairs == [(0, "l0", "r0"), (50 * ms, "l1", "r1"), (150 * ms, "l3", "r3")]
    assert counts == {"unmatched left": 0, "unmatched right": 1, "out of order": 1}


@pytest.mark.parametrize("sides", ((0,), (1,), (0, 1)))
@pytest.mark.parametrize("wrong", (0, 3, 6))
@pytest.mark.parametrize("stamp", (0, -7, 10**15))
def test_one_wrong_stamp_costs_one_pair(sides, wrong, stamp):
    ms = 1_000_000
    stream = [(side, stamp + side if i == wrong and side in sides else 10**12 + (50 * i + side) * ms, i)
              for i in range(10) for side in (0, 1)]
    counts = {}
    pairs = list(recordings.pair_by_time(iter(stream), 0.01, counts))
    kept = [i for i in range(10) if i != wrong]
    if wrong == 0 and stamp <= 0 and len(sides) == 2:  # early, but in order
        kept = list(range(10))
    assert [(a, b) for _, a, b in pairs] == [(i, i) for i in kept]
    assert sum(counts.values()) == (2 if len(kept) == 9 else 0)


def test_pairing_after_a_lost_image():
    """The second right image is lost; the tolerance is above half the spacing."""
    ms = 1_000_000
    stream = [(side, (50 * i + 2 * side) * ms, (side, i)) for i in range(6) for side in (0, 1)
              if (side, i) != (1, 1)]
    for lost in (0, 1):  # the same with the sides exchanged
        counts = {}
        given = [(side ^ lost, stamp, item) for side, stamp, item in stream]
        pairs = list(recordings.pair_by_time(iter(given), 0.06, counts))
        assert [(a[1], b[1]) for _, a, b in pairs] == [(i, i) for i in (0, 2, 3, 4, 5)]
        assert counts["unmatched left"] + counts["unmatched right"] == 1


class Held:
    """An item that counts how many there are."""
    now = most = 0

    def __init__(self, number):
        self.number = number
        Held.now += 1
        Held.most = max(Held.most, Held.now)

    def __del__(self):
        Held.now -= 1


@pytest.mark.parametrize("sides", ((0, 1), (1, 0)))
@pytest.mark.parametrize("begin, end, ahead_s, paired", (
    (0, 50, 0, range(50)),  # the second camera ends early
    (0, 1, 0, range(1)),
    (1999, 2000, 0, range(1999, 2000)),  # starts late
    (0, 0, 0, ()),  # has no images
    (0, 2000, 1e9, ()), (0, 2000, -1e9, ()),  # another clock
    (0, 2000, 0, range(2000)))
)
def test_a_camera_without_the_other_takes_no_memory(sides, begin, end, ahead_s, paired):
    """2000 images of one camera, `begin` to `end` of the other one."""
    ms = 1_000_000
    Held.now = Held.most = 0
    stream = ((sides[side], (50 * i + side) * ms + side * int(ahead_s) * 10**9, Held(i))
              for i in range(2000) for side in (0, 1) if side == 0 or begin <= i < end)
    counts = {}
    pairs = [(a.number, b.number)
             for _, a, b in recordings.pair_by_time(stream, 0.01, counts)]
    assert pairs == [(i, i) for i in paired]
    assert Held.most < 120
    of_side = [counts["unmatched left"], counts["unmatched right"]]
    assert of_side[sides[0]] == 2000 - len(paired)
    assert of_side[sides[1]] == end - begin - len(paired)


def test_a_topic_without_a_slash():
    from types import SimpleNamespace
    k = [50.0, 0, 30, 0, 50, 20, 0, 0, 1]
    roi = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)
    info = SimpleNamespace(width=60, height=40, binning_x=0, binning_y=0, roi=roi, distortion_model="plumb_bob", d=[0.0] * 5, k=k,
                           r=[1.0, 0, 0, 0, 1, 0, 0, 0, 1], p=[0.0] * 12)
    connection = SimpleNamespace(topic="left/camera_info", msgtype="sensor_msgs/msg/CameraInfo")
    reader = SimpleNamespace(connections=[connection], deserialize=lambda raw, kind: info,
                             messages=lambda connections: iter([(connection, 0, b"")]))
    assert recordings._camera_info(reader, "x.mcap", "left")["K"] == k


def write_video(path, images, rate=10):
    cv2 = pytest.importorskip("cv2")
    height, width = images[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), rate, (width, height))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no lossless video")
    for image in images:
        writer.write(np.repeat(image[:, :, None], 3, 2))
    writer.release()


OWN = """left: {width: 320, height: 240, fx: 250, fy: 250, cx: 159.5, cy: 119.5}
right: {width: 320, height: 240, fx: 250, fy: 250, cx: 159.5, cy: 119.5}
T_left_right: [1, 0, 0, 0.2,  0, 1, 0, 0,  0, 0, 1, 0,  0, 0, 0, 1]
"""


def test_videos(corridor, tmp_path):
    (tmp_path / "camera.yaml").write_text(OWN)
    write_video(tmp_path / "left.avi", [c[0] for c in corridor])
    write_video(tmp_path / "right.avi", [c[1] for c in corridor])
    write_video(tmp_path / "both.avi", [np.hstack(c[:2]) for c in corridor])
    calibration = ("--calibration", tmp_path / "camera.yaml", "--set", "orb.features=600")
    two, two_bytes = run(tmp_path, tmp_path / "left.avi", tmp_path / "right.avi", *calibration)
    one, one_bytes = run(tmp_path, tmp_path / "both.avi", *calibration)
    assert one_bytes == two_bytes
    assert len(two) == len(corridor)
    truth = np.array([c[3] for c in corridor])
    assert np.abs(two[:, 1:4] - truth).max() < 0.03


def test_videos_of_different_rates(corridor, tmp_path, capsys):
    """Pairs by number would drift apart; one frame apart at the end is what containers round."""
    (tmp_path / "camera.yaml").write_text(OWN)
    write_video(tmp_path / "left.avi", [c[0] for c in corridor])
    write_video(tmp_path / "right.avi", [c[1] for c in corridor], 12.5)
    write_video(tmp_path / "near.avi", [c[1] for c in corridor], 10.05)
    calibration = ("--calibration", tmp_path / "camera.yaml", "--set", "orb.features=600")
    videos = [str(tmp_path / name) for name in ("left.avi", "right.avi")]
    assert cli.main(["run", *videos, *map(str, calibration), "--output", str(tmp_path / "o")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "right.avi: 12.5 frames per second" in error and "--rate" in error
    said = run(tmp_path, *videos, *calibration, "--rate", 10)[1]
    assert run(tmp_path, tmp_path / "left.avi", tmp_path / "near.avi", *calibration)[1] == said


def test_feature_files_with_priors_choose_the_mode(tmp_path):
    """As run_stereo_kitti does, to the byte."""
    (tmp_path / "drive.txt").write_text("".join(f"1 0 0 0 0 1 0 0 0 0 1 {0.6 * i}\n" for i in range(12)))
    features = tmp_path / "drive.features"
    simulate = ("simulate_features", tmp_path / "drive.txt", "--output", features, "--features", 800,
                "--traffic", "jam", "--quiet", "--perception")
    for perception, options, mode in (("estimated", (), "verified"), ("estimated", ("--mode", "kys"), "kys"),
                                      ("none", (), "stock")):
        run_program(*simulate, perception)
        run_program("run_stereo_kitti", features, "--quiet", "--output", tmp_path / "c++", *options,
                    "--overwrite")
        assert run(tmp_path, features, *options)[1] == (tmp_path / "c++" / "trajectory.tum").read_bytes()
        ours, theirs = (json.loads((tmp_path / folder / "summary.json").read_text())
                        for folder in ("run", "c++"))
        assert ours["mode"] == theirs["mode"] == mode
        assert ours.get("missing_priors") == theirs.get("missing_priors")
        assert ours["recording"] == theirs["recording"]
    with pytest.raises(AssertionError):
        run(tmp_path, features, "--mode", "kys")


def test_mask_folder(corridor, tmp_path):
    cv2 = pytest.importorskip("cv2")
    (tmp_path / "camera.yaml").write_text(OWN)
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        (tmp_path / "masks" / side).mkdir(parents=True)
        for i, shot in enumerate(corridor):
            cv2.imwrite(str(tmp_path / side / f"{i:06d}.png"), shot[side == "right"])
            mask = np.zeros((240, 320), np.uint8)
            mask[:100] = 3
            cv2.imwrite(str(tmp_path / "masks" / side / f"{i:06d}.png"), mask)
    run(tmp_path, tmp_path, "--calibration", tmp_path / "camera.yaml", "--rate", 10, "--masks",
        tmp_path / "masks", "--set", "orb.features=600")
    rows = (tmp_path / "run" / "frames.csv").read_text().splitlines()
    masked = rows[0].split(",").index("masked")
    import csv
    assert all(int(row[masked]) > 0 for row in csv.reader(rows[1:]))


def test_wrong_turns(tmp_path, corridor, capsys):
    def says(text, *arguments):
        assert cli.main(["run", *map(str, arguments)]) == 2
        error = capsys.readouterr().err
        assert text in error and error.count("\n") == 1, error

    cv2 = pytest.importorskip("cv2")
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for i, shot in enumerate(corridor[:2]):
            cv2.imwrite(str(tmp_path / side / f"{i}.png"), shot[side == "right"])
    (tmp_path / "camera.yaml").write_text(OWN)
    pair = (tmp_path / "left", tmp_path / "right")
    calibration = ("--calibration", tmp_path / "camera.yaml")
    says("no such file", tmp_path / "none")
    says("--calibration", *pair)
    says("--rate or --times", *pair, *calibration)
    says("swapped", *pair[::-1], *calibration, "--rate", 10, "--output", tmp_path / "o")
    says("neither two folders", pair[0], tmp_path / "camera.yaml", *calibration)
    (tmp_path / "priors").mkdir()
    (tmp_path / "priors" / "1.kysp").touch()
    says("--priors", tmp_path / "priors")
    says("give it to --priors", *pair, *calibration, "--rate", 10, "--masks", tmp_path / "priors")
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "summary.json").touch()
    says("--overwrite", *pair, *calibration, "--rate", 10, "--output", tmp_path / "old")
    says("results of a run", tmp_path / "old")
    says("needs priors", *pair, *calibration, "--rate", 10, "--mode", "kys")
    says("unknown setting", *pair, *calibration, "--rate", 10, "--set", "orb.featurs=3")
    video = tmp_path / "broken.mp4"
    video.write_bytes(b"not a video")
    says("not a video", video, *calibration)
    bag = tmp_path / "broken.bag"
    bag.write_bytes(b"not a bag")
    says("not a bag", bag)
    shutil.rmtree(tmp_path / "right")
    says("no such", *pair, *calibration)


def plot_says_what_evaluate_says(tmp_path, capsys):
    """evo under `plot` and our own evaluation: the same figures; several runs in one picture."""
    pytest.importorskip("evo")
    from kys_slam.plot import load_run
    own = kys_slam.evaluate(*kys_slam.read_tum(tmp_path / "run" / "ground_truth.tum"),
                            *kys_slam.read_tum(tmp_path / "run" / "trajectory.tum"))
    evo = load_run(tmp_path / "run", None)
    for key in ("rmse", "mean", "median", "max"):
        assert abs(evo.figures[key] - own["ate_m"][key]) < 1e-6, key
    assert np.abs(np.linalg.norm(evo.path.poses[:, :3, 3] - evo.truth.poses[:, :3, 3], axis=1) -
                  evo.errors).max() < 1e-9  # the path that is drawn is the aligned one
    # A second run, half as large: sim3 takes that back, se3 does not.
    times, poses = kys_slam.read_tum(tmp_path / "run" / "trajectory.tum")
    poses[:, :3, 3] /= 2
    kys_slam.write_tum(tmp_path / "half.tum", times, poses)
    reference = tmp_path / "run" / "ground_truth.tum"
    se3, sim3 = (load_run(tmp_path / "half.tum", reference, align) for align in ("se3", "sim3"))
    assert se3.figures["rmse"] > 0.1 and abs(sim3.figures["rmse"] - own["ate_m"]["rmse"]) < 0.01
    capsys.readouterr()
    assert cli.main(["plot", str(tmp_path / "run"), str(tmp_path / "half.tum"), "--reference",
                     str(reference), "--output", str(tmp_path / "p.png")]) == 0
    printed = capsys.readouterr().out
    assert f"{own['ate_m']['rmse']:.4f}" in printed and "half.tum" in printed
    assert (tmp_path / "p.png").stat().st_size > 5000
    times += 1000
    kys_slam.write_tum(tmp_path / "later.tum", times, poses)
    assert cli.main(["plot", str(tmp_path / "later.tum"), "--reference", str(reference)]) == 2
    assert "no times in common" in capsys.readouterr().err
    assert cli.main(["plot", str(tmp_path / "half.tum"), "--output", str(tmp_path / "q.png")]) == 0


def drive_along_a_wall(folder, late):
    """24 pairs whose rows move from frame to frame, the right camera's some frames later."""
    cv2 = pytest.importorskip("cv2")
    random = np.random.default_rng(5)
    wall = np.full((160, 600), 128, np.uint8)
    for _ in range(1500):
        side, x, y = random.integers(4, 18), random.integers(0, 580), random.integers(0, 140)
        wall[y:y + side, x:x + side] = random.integers(0, 256)
    for i in range(24):
        for side in (0, 1):
            k = max(0, i - late * side)
            left, top = 60 + 6 * k + 16 * side, (0, 2, 3, 1, 4, 0, 3)[k % 7]
            path = folder / ("left", "right")[side] / f"{i:03d}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), wall[top:top + 120, left:left + 320])
    camera = ("{width: 320, height: 120, fx: 200, fy: 200, cx: 160, cy: 60, model: radtan, "
              "distortion: [0, 0, 0, 0]}")
    (folder / "camera.yaml").write_text(
        f"left: {camera}\nright: {camera}\n"
        "T_left_right: [1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n")


def test_out_of_step_is_told(tmp_path, capsys):
    for late in (0, 1):
        folder = tmp_path / str(late)
        drive_along_a_wall(folder, late)
        cli.main(["run", str(folder / "left"), str(folder / "right"), "--calibration",
                  str(folder / "camera.yaml"), "--rate", "10", "--output", str(folder / "run"), "--quiet"])
        told = json.loads((folder / "run" / "summary.json").read_text())["warnings"]
        error = capsys.readouterr().err
        if late:
            out_of_step = [text for text in told if "not of the same moment" in text]
            assert len(out_of_step) == 1 and error.count(out_of_step[0]) == 1
            # The second right picture is the first one once more.
            assert any("right image is that of the frame before" in text for text in told)
        else:
            assert told == [] and "warning" not in error


def test_evaluate_and_plot(tmp_path, corridor, corridor_camera, capsys):
    pytest.importorskip("matplotlib")
    slam = kys_slam.System(corridor_camera, {"orb.features": 600})
    poses = np.tile(np.eye(4), (len(corridor), 1, 1))
    for i, (left, right, timestamp, position) in enumerate(corridor):
        slam.feed(left, right, timestamp)
        poses[i, :3, 3] = position
    slam.finish()
    slam.write_run(tmp_path / "run", "corridor", (np.array([c[2] for c in corridor]), poses))
    assert cli.main(["evaluate", str(tmp_path / "run")]) == 0
    assert "ATE, rmse" in capsys.readouterr().out
    plot_says_what_evaluate_says(tmp_path, capsys)
    assert cli.main(["demo", "--frames", "5"]) == 0
    page = tmp_path / "report.html"
    assert cli.main(["report", str(tmp_path / "run"), "--output", str(page)]) == 0
    text = page.read_text()
    assert f"{len(corridor)} of {len(corridor)}" in text and text.count("data:image/png") == 3
    capsys.readouterr()
    for command in ("report", "evaluate", "plot", "view"):
        assert cli.main([command, str(tmp_path)]) == 2
        error = capsys.readouterr().err
        assert str(tmp_path) in error and error.count("\n") == 1, error
    pytest.importorskip("shtab")
    assert cli.main(["completion", "bash"]) == 0
    assert "--calibration-unit" in capsys.readouterr().out
    times, read = kys_slam.read_tum(tmp_path / "run" / "trajectory.tum")
    kys_slam.write_tum(tmp_path / "again.tum", times, read)
    assert (tmp_path / "again.tum").read_bytes() == (tmp_path / "run" /
                                                     "trajectory.tum").read_bytes()


def test_what_becomes_of_late_frames():
    """Five frames come while three may wait and none is fetched."""
    from kys_slam.live import FrameQueue
    for policy, kept in (("drop-oldest", [2, 3, 4]), ("drop-newest", [0, 1, 2])):
        frames = FrameQueue(policy, 3)
        taken = [frames.put(i) for i in range(5)]
        assert taken == ([True] * 5 if policy == "drop-oldest" else [True] * 3 + [False] * 2)
        frames.close()
        assert list(frames) == kept
        assert (frames.received, frames.dropped) == (5, 2)
        assert not frames.put(6)
    frames = FrameQueue("wait", 3)
    writer = threading.Thread(target=lambda: [frames.put(i) for i in range(50)] + [frames.close()])
    writer.start()
    assert list(frames) == list(range(50)) and frames.dropped == 0
    writer.join()
    with pytest.raises(kys_slam.InputError, match="no policy"):
        FrameQueue("drop")
    with pytest.raises(kys_slam.InputError, match="at least one"):
        FrameQueue(capacity=0)


def test_errors_of_a_recording_come_after_its_frames():
    from kys_slam.live import Playback

    class Frame:
        timestamp = 0.0

    def broken():
        yield from (Frame(), Frame())
        raise kys_slam.InputError("the third is broken")

    seen = []
    with pytest.raises(kys_slam.InputError, match="third"):
        for frame in Playback(broken()):
            seen.append(frame)
    assert len(seen) == 2
    # Who stops early ends the thread that reads.
    endless = (Frame() for _ in iter(int, 1))
    for frame in Playback(endless):
        break


def test_frames_that_come_too_fast_are_counted(shots, camchain, tmp_path, capsys):
    """A flight played at 1000 times its pace: every frame is tracked or counted."""
    bag = tmp_path / "flight.bag"
    write_bag(bag, "ros1", shots, "mono8")
    base = ["run", str(bag), "--calibration", str(camchain), "--schedule", "realtime", "--speed", "1000"]
    for policy in ("drop-oldest", "drop-newest", "wait"):
        out = tmp_path / policy
        status = cli.main([*base, "--late", policy, "--output", str(out)])
        printed = capsys.readouterr().out
        summary = json.loads((out / "summary.json").read_text())
        dropped = summary["left_out"].get("frames that came too fast", 0)
        assert summary["frames"] + dropped == len(shots)
        if policy == "wait":
            assert status == 0 and dropped == 0
        else:
            assert dropped > 0 and f"frames that came too fast    {dropped}" in printed
        assert len((out / "frames.csv").read_text().splitlines()) == 1 + summary["frames"]
    assert cli.main([*base[:4], "--late", "drop-oldest", "--output", str(tmp_path / "x")]) == 2
    assert "--schedule realtime" in capsys.readouterr().err
    pytest.importorskip("matplotlib")
    assert cli.main(["report", str(tmp_path / "drop-oldest"), "--output",
                     str(tmp_path / "page.html")]) == 0
    assert "frames that came too fast" in (tmp_path / "page.html").read_text()
