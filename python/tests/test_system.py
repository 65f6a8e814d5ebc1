# SPDX-License-Identifier: BSD-3-Clause
"""The system fed with NumPy arrays: the same poses as the command line, errors, threads."""

import functools
import gc
import sys
import threading
import time
import weakref
from pathlib import Path

import numpy as np
import pytest

import kys_slam
from conftest import ROOT


def run_kitti(kitti, folder, change=lambda image: image, **options):
    """Feeds the excerpt as arrays made by `change`; returns trajectory.tum."""
    sequence = kys_slam.open_sequence(kitti)
    slam = kys_slam.System(sequence.camera)
    for frame in sequence:
        slam.feed(change(frame.left), change(frame.right), frame.timestamp, name=frame.name,
                  **options)
    slam.finish()
    slam.write_run(folder, sequence.name, sequence.ground_truth)
    return (folder / "trajectory.tum").read_bytes()


def strided(image):
    """The same pixels as every second one of every third row of something larger, upside down."""
    height, width = image.shape
    large = np.full((3 * height, 2 * width), 77, np.uint8)
    large[::-3, ::2] = image
    view = large[::-3, ::2]
    assert view.strides[0] < 0 and not view.flags.c_contiguous
    return view


def coloured(image):
    """Grey as blue, green, red, channels first in memory."""
    return np.moveaxis(np.stack([image] * 3), 0, 2)


@pytest.mark.parametrize("change", [lambda i: i, strided, coloured,
                                    lambda i: i.astype(np.uint16) << 8 | 0x55])
def test_arrays_give_the_command_lines_trajectory(kitti, kitti_tum, tmp_path, change):
    assert run_kitti(kitti, tmp_path, change) == kitti_tum


def test_fed_from_a_thread(kitti, kitti_tum, tmp_path):
    result = []
    thread = threading.Thread(target=lambda: result.append(run_kitti(kitti, tmp_path)))
    thread.start()
    thread.join()
    assert result == [kitti_tum]


def test_looking_on_changes_nothing(kitti, kitti_tum, tmp_path):
    sequence = kys_slam.open_sequence(kitti)
    seen = []
    slam = kys_slam.System(sequence.camera, observer=seen.append)
    stop, counts, errors = threading.Event(), [], []

    def look():
        while not stop.is_set():
            try:
                snapshot = slam.snapshot()
                counts.append(len(snapshot.landmark_points))
                assert len(slam.trajectory().poses) >= snapshot.frames
                slam.landmarks(), slam.keyframes(), slam.submaps
            except Exception as error:  # noqa: BLE001 - shown below
                errors.append(error)

    thread = threading.Thread(target=look)
    thread.start()
    for frame in sequence:
        slam.feed_frame(frame)
    stop.set()
    thread.join()
    slam.finish()
    slam.write_run(tmp_path, "06")
    assert not errors
    assert counts and max(counts) > 1000
    assert (tmp_path / "trajectory.tum").read_bytes() == kitti_tum
    assert [s.report.index for s in seen] == list(range(51))
    last = seen[-1]
    assert last.keypoints.shape == (last.report.keypoints, 2)
    assert np.count_nonzero(last.landmarks >= 0) >= last.report.inliers > 100
    assert np.count_nonzero(last.depths > 0) == last.report.stereo_matches
    assert last.labels is None


def test_other_threads_run_while_a_frame_is_fed(kitti):
    sequence = kys_slam.open_sequence(kitti, frames=3)
    slam = kys_slam.System(sequence.camera)
    frames = [(f.left, f.right, f.timestamp) for f in sequence]
    ticks, stop = [0], threading.Event()

    def tick():
        while not stop.is_set():
            ticks[0] += 1
            time.sleep(0.0005)  # gives the GIL back, which nothing else makes it do below

    interval = sys.getswitchinterval()
    thread = threading.Thread(target=tick)
    thread.start()
    try:
        sys.setswitchinterval(1000)  # from here on the GIL changes hands only where it is released
        before = ticks[0]
        for frame in frames:
            slam.feed(*frame)
        during = ticks[0] - before
    finally:
        stop.set()
        sys.setswitchinterval(interval)
        thread.join()
    assert during > 0


def test_snapshot_and_trajectory_agree(corridor, corridor_camera):
    slam = kys_slam.System(corridor_camera, {"orb.features": 600})
    for left, right, timestamp, _ in corridor:
        assert not slam.feed(left, right, timestamp).lost
    slam.finish()
    trajectory, snapshot = slam.trajectory(), slam.snapshot()
    truth = np.array([position for *_, position in corridor])
    assert trajectory.connected.all()
    assert np.abs(trajectory.poses[:, :3, 3] - truth).max() < 0.03
    assert snapshot.frames == len(corridor)
    own = snapshot.landmark_submaps == snapshot.main_submap
    assert np.array_equal(snapshot.landmark_points[own], slam.landmarks())
    assert (snapshot.landmark_observations >= 1).all()
    times, poses = slam.keyframes()
    assert np.array_equal(times, snapshot.keyframe_times)
    assert np.array_equal(poses, snapshot.keyframe_poses)
    assert set(snapshot.edges.ravel()) <= set(snapshot.keyframe_ids)


def test_wrong_input_raises(corridor, corridor_camera):
    slam = kys_slam.System(corridor_camera)
    left, right, *_ = corridor[0]
    with pytest.raises(kys_slam.InputError, match="320x240"):
        slam.feed(left[:, :-1], right, 0.0)
    with pytest.raises(kys_slam.InputError, match="shape"):
        slam.feed(left.ravel(), right, 0.0)
    with pytest.raises(kys_slam.InputError, match="channels"):
        slam.feed(np.dstack([left] * 2), right, 0.0)
    with pytest.raises(TypeError, match="uint8"):
        slam.feed(left.astype(np.float32), right, 0.0)
    with pytest.raises(TypeError):
        slam.feed("left.png", right, 0.0)
    with pytest.raises(kys_slam.InputError, match="finite"):
        slam.feed(left, right, float("nan"))
    with pytest.raises(kys_slam.InputError, match="1 to 16384"):
        slam.feed(left[:0], right, 0.0)
    slam.feed(left, right, 1.0)
    with pytest.raises(kys_slam.InputError, match="time stamp"):
        slam.feed(left, right, 1.0)
    slam.finish()
    with pytest.raises(kys_slam.LogicError, match="finish"):
        slam.feed(left, right, 2.0)
    with pytest.raises(RuntimeError):
        slam.load_map("some.map")
    assert issubclass(kys_slam.InputError, ValueError)


def test_settings():
    settings = kys_slam.Settings({"orb.features": 600, "stereo.refine": False})
    assert settings["orb.features"] == "600" and settings["stereo.refine"] == "false"
    with pytest.raises(kys_slam.InputError, match="orb.features"):
        settings["orb.featurs"] = 1
    with pytest.raises(kys_slam.InputError):
        kys_slam.System(kys_slam.StereoCamera(320, 240, 250, 250, 160, 120, 0.2),
                        {"orb.levels": 0})
    with pytest.raises(kys_slam.InputError):
        kys_slam.StereoCamera(320, 240, 250, 250, 160, 120, -0.2)


def test_masked_pixels_give_no_keypoints(corridor, corridor_camera):
    mask = np.zeros((240, 320), np.uint8)
    mask[:, :160] = 1
    seen = []
    slam = kys_slam.System(corridor_camera, {"orb.features": 600}, observer=seen.append)
    left, right, *_ = corridor[0]
    report = slam.feed(left, right, 0.0, masks=(mask, None))
    assert report.masked > 100
    assert seen[0].keypoints[:, 0].min() >= 159.5
    with pytest.raises(kys_slam.InputError, match="left mask|a mask"):
        slam.feed(left, right, 1.0, masks=(mask[:, 1:], None))


def test_an_observer_that_knows_its_system_is_collected(corridor, corridor_camera):
    slam = kys_slam.System(corridor_camera, {"orb.features": 600})
    slam.set_observer(lambda seen: slam.snapshot())
    slam.feed(*corridor[0][:3])
    gone = weakref.ref(slam)
    del slam
    gc.collect()
    assert gone() is None


def test_observer_that_raises_is_told(corridor, corridor_camera):
    def fail(_):
        raise KeyError("mine")

    slam = kys_slam.System(corridor_camera, observer=fail)
    with pytest.raises(KeyError):
        slam.feed(*corridor[0][:3])
    slam.set_observer(None)
    assert slam.feed(*corridor[1][:3]).index == 1  # the first one is tracked all the same
    assert slam.feed(*corridor[2][:3], index=70).index == 70
    assert [r.index for r in slam.reports()] == [0, 1, 70]


def test_stubs_say_types():
    """What a type checker has to know to check a loop over frames."""
    stub = Path(kys_slam._core.__file__).with_name("_core.pyi").read_text()
    assert "-> object" not in stub
    assert "def __iter__(self) -> Iterator[StereoFrame]" in stub
    assert Path(kys_slam.__file__).with_name("py.typed").exists()


def test_example_writes_one_submap(corridor, corridor_camera, tmp_path, monkeypatch):
    """Darkness, then another corridor: two sub-maps, and the points of one."""
    cv2 = pytest.importorskip("cv2")
    dark = (np.zeros((240, 320), np.uint8),) * 2
    other = [[image[::-1] for image in c[:2]] for c in corridor]  # a sub-map waits for some frames
    frames = [c[:2] for c in corridor] + [dark] * 3 + [other[0]] * 12 + other
    for side in (0, 1):
        (tmp_path / f"image_{side}").mkdir()
        for i, frame in enumerate(frames):
            cv2.imwrite(str(tmp_path / f"image_{side}" / f"{i:06d}.png"), frame[side])
    (tmp_path / "times.txt").write_text("".join(f"{i / 10}\n" for i in range(len(frames))))
    (tmp_path / "calib.txt").write_text(
        "P0: 250 0 159.5 0 0 250 119.5 0 0 0 1 0\nP1: 250 0 159.5 -50 0 250 119.5 0 0 0 1 0\n")
    system = functools.partial(kys_slam.System, settings={"orb.features": 600})  # more keyframes
    slam = system(corridor_camera)
    for frame in kys_slam.open_sequence(tmp_path):
        slam.feed_frame(frame)
    slam.finish()
    seen = slam.snapshot()
    often = seen.landmark_observations >= 3
    main = seen.landmark_submaps == seen.main_submap
    assert slam.submaps == 2 and np.count_nonzero(often & main) < np.count_nonzero(often)
    monkeypatch.setattr(kys_slam, "System", system)
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    import track
    track.main(str(tmp_path), str(tmp_path / "map.ply"))
    data = (tmp_path / "map.ply").read_bytes().split(b"end_header\n", 1)[1]
    assert np.array_equal(np.frombuffer(data, "<f4").reshape(-1, 3),
                          seen.landmark_points[often & main].astype("<f4"))


def test_covariances_of_the_poses(kitti, tmp_path):
    sequence = kys_slam.open_sequence(kitti)
    slam = kys_slam.System(sequence.camera)
    reports = [slam.feed_frame(frame) for frame in sequence]
    slam.finish()
    assert reports[0].status == "started"
    assert reports[0].covariance is None and reports[0].motion is None
    for before, report in zip(reports, reports[1:]):
        if report.status != "tracked":
            assert report.covariance is None and report.motion_covariance is None
            continue
        for covariance in (report.covariance, report.motion_covariance):
            assert covariance.shape == (6, 6) and np.array_equal(covariance, covariance.T)
            assert np.linalg.eigvalsh(covariance).min() > 0
        assert report.motion.other == before.index and report.local.other <= before.index
        assert np.array_equal(report.motion.covariance, report.motion_covariance)
    path = slam.trajectory()
    tracked = np.array([r.status == "tracked" for r in reports])
    assert path.covariances.shape == path.motion_covariances.shape == (len(reports), 6, 6)
    assert np.array_equal(~np.isnan(path.covariances).any(axis=(1, 2)), tracked)
    assert np.array_equal(path.covariances[tracked][-1], reports[-1].covariance)
    slam.write_run(tmp_path, sequence.name)
    rows = (tmp_path / "covariance.csv").read_text().splitlines()
    assert len(rows) == 1 + 2 * tracked.sum()
    last = rows[-1].split(",")
    assert last[:4:2] == [str(reports[-1].index), "motion"] and len(last) == 11 + 21
    upper = reports[-1].motion_covariance[np.triu_indices(6)]
    assert np.allclose([float(v) for v in last[11:]], upper, rtol=1e-5)
