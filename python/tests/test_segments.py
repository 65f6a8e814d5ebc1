# SPDX-License-Identifier: BSD-3-Clause
"""Segments beside the tracker: from a thread, late, for some frames, from stored files."""

import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import kys_slam
from conftest import ROOT
from kys_slam.cli import main
from kys_slam.segmenter import Segmenter

SPACE = kys_slam.LabelSpace("coco_panoptic_133")
ROAD = dict(zip(SPACE.names, SPACE.ids))["road"]


class Frame:
    """As recordings have them."""

    def __init__(self, name, left, right, timestamp):
        self.name, self.left, self.right, self.timestamp = name, left, right, timestamp


@pytest.fixture(scope="module")
def frames(corridor):
    return [Frame(f"{i:06d}", left, right, time) for i, (left, right, time, _) in enumerate(corridor)]


def all_road(frame):
    return kys_slam.priors_from_labels(SPACE, np.full(frame.left.shape, ROAD))


def run(frames, camera, function, every=3, lag=2, schedule="sequential", timeout=30, **settings):
    """The segmenter, the reports as they were returned, and the system after the run."""
    slam = kys_slam.System(camera, {"kys.mode": "verified", "control.segment_every": every,
                                    "control.segment_lag": lag, "control.segment_timeout": timeout,
                                    "orb.features": 600, **settings}, schedule)
    reports = []
    with Segmenter(slam, function, every, schedule == "realtime") as segmenter:
        for frame in frames:
            segmenter.offer(frame)
            reports.append(slam.feed(frame.left, frame.right, frame.timestamp, name=frame.name))
            segmenter.fed()
    slam.finish()
    return segmenter, reports, slam


@pytest.mark.parametrize("schedule", ["sequential", "pipelined"])
def test_a_slow_function_changes_nothing(frames, corridor_camera, schedule):
    def slow(frame):
        time.sleep(0.05)
        return all_road(frame)

    one, reports, fast_slam = run(frames, corridor_camera, all_road, schedule=schedule)
    two, _, slow_slam = run(frames, corridor_camera, slow, schedule=schedule)
    assert [r.segments_of for r in reports] == [-1, -1, 0, -1, -1, 3, -1, -1, 6, -1, -1, 9]
    assert one.segmented == two.segmented == 4
    assert fast_slam.trajectory().connected.all()
    assert np.array_equal(fast_slam.trajectory().poses, slow_slam.trajectory().poses)
    assert all(r.prior_coverage > 0.9 for r in fast_slam.reports()[2:])


def test_a_function_that_fails_ends_segments_but_not_the_run(frames, corridor_camera):
    def fails(frame):
        if frame.name == "000003":
            raise ValueError("out of memory on the device")
        return all_road(frame)

    segmenter, reports, slam = run(frames, corridor_camera, fails)
    assert "000003" in segmenter.error and "out of memory on the device" in segmenter.error
    assert slam.trajectory().connected.all() and segmenter.segmented == 1


def test_a_function_that_hangs_is_waited_for_once(frames, corridor_camera):
    leave = threading.Event()

    def hangs(frame):
        leave.wait(20)

    slam = kys_slam.System(corridor_camera, {"kys.mode": "verified", "control.segment_every": 1,
                                             "control.segment_timeout": 0.1})
    segmenter = Segmenter(slam, hangs)
    with segmenter:
        warnings = []
        for frame in frames:
            segmenter.offer(frame)
            warnings.append(slam.feed(frame.left, frame.right, frame.timestamp).warning)
            segmenter.fed()
        leave.set()
    slam.finish()
    assert sum("control.segment_timeout" in w for w in warnings) == 1
    assert slam.trajectory().connected.all()


def test_an_image_without_segments_and_a_frame_without_any(frames, corridor_camera):
    def nothing(frame):
        if frame.name == "000003":
            return None
        return kys_slam.priors_from_labels(SPACE, np.full(frame.left.shape, -1))

    segmenter, _, slam = run(frames, corridor_camera, nothing)
    assert segmenter.error == "" and segmenter.segmented == 3
    assert slam.trajectory().connected.all()


def test_a_wrong_size_or_label_space_ends_segments_with_one_line(frames, corridor_camera):
    small = lambda frame: kys_slam.priors_from_labels(SPACE, np.full((10, 20), ROAD))
    segmenter, _, slam = run(frames, corridor_camera, small)
    assert "20x10" in segmenter.error and slam.trajectory().connected.all()
    city = kys_slam.LabelSpace("cityscapes_19")
    other = lambda frame: kys_slam.priors_from_labels(city, np.zeros(frame.left.shape, int))
    segmenter, _, _ = run(frames, corridor_camera, other)
    assert "cityscapes_19" in segmenter.error and "coco_panoptic_133" in segmenter.error


def test_realtime_skips_frames_for_the_network_only(frames, corridor_camera):
    def slow(frame):
        time.sleep(0.15)
        return all_road(frame)

    segmenter, reports, slam = run(frames * 1, corridor_camera, slow, every=1, lag=0,
                                   schedule="realtime")
    assert segmenter.skipped > 0 and segmenter.segmented + segmenter.skipped == len(frames)
    assert len(slam.reports()) == len(frames)


@pytest.fixture(scope="module")
def sequence(frames, tmp_path_factory):
    cv2 = pytest.importorskip("cv2")
    folder = tmp_path_factory.mktemp("sequence")
    for side in ("left", "right"):
        image = folder / ("image_0" if side == "left" else "image_1")
        image.mkdir()
        for frame in frames:
            cv2.imwrite(str(image / f"{frame.name}.png"), getattr(frame, side))
    (folder / "times.txt").write_text("".join(f"{f.timestamp}\n" for f in frames))
    (folder / "calib.txt").write_text(
        "P0: 250 0 159.5 0 0 250 119.5 0 0 0 1 0\nP1: 250 0 159.5 -50 0 250 119.5 0 0 0 1 0\n")
    return folder


def kys_slam_run(*arguments):
    return main(["run", *map(str, arguments), "--quiet"])


def test_stored_segments_take_the_place_of_the_network(sequence, frames, tmp_path, corridor_camera, capfd):
    stored = tmp_path / "stored"
    stored.mkdir()
    for frame in frames[::2]:
        kys_slam.write_prior(stored / f"{frame.name}.kysp", all_road(frame))
    texts = []
    for name in ("one", "two"):
        assert kys_slam_run(sequence, "--segment", stored, "--segment-every", 2, "--segment-lag", 3,
                            "--output", tmp_path / name, "--save-priors", tmp_path / f"{name}-priors") == 0
        texts.append((tmp_path / name / "trajectory.tum").read_bytes())
    assert texts[0] == texts[1]
    for frame in frames[::2]:
        file = f"{frame.name}.kysp"
        assert (tmp_path / "one-priors" / file).read_bytes() == (stored / file).read_bytes()
    assert "mode: verified" in (tmp_path / "one" / "config.yaml").read_text()


def test_a_failure_in_a_run_is_one_warning_and_the_same_bytes(sequence, frames, tmp_path, capfd):
    stored = tmp_path / "stored"
    stored.mkdir()
    for frame in frames[::2]:
        kys_slam.write_prior(stored / f"{frame.name}.kysp", all_road(frame))
    damaged = stored / "000004.kysp"
    damaged.write_bytes(damaged.read_bytes()[:100])
    texts = []
    for name in ("one", "two"):
        assert kys_slam_run(sequence, "--segment", stored, "--segment-every", 2, "--segment-lag", 1,
                            "--output", tmp_path / name) == 0
        said = [line for line in capfd.readouterr().err.splitlines() if "000004" in line]
        assert len(said) == 1 and "the run goes on without segments" in said[0]
        texts.append((tmp_path / name / "trajectory.tum").read_bytes())
    assert texts[0] == texts[1] and len(texts[0].splitlines()) == len(frames)


@pytest.mark.parametrize("arguments, what", [
    (["--segment-every", "2"], "--segment-every needs --segment"),
    (["--save-priors", "x"], "--save-priors needs --segment"),
    (["--segment", "none.yaml"], "none.yaml"),
    (["--segment", ".", "--segment-lag", "1", "--schedule", "realtime"], "--segment-lag"),
    (["--segment", "."], "has no prior files")])
def test_wrong_options_end_with_one_line(sequence, tmp_path, monkeypatch, capfd, arguments, what):
    if what == "none.yaml":
        pytest.importorskip("onnxruntime")
    monkeypatch.chdir(tmp_path)
    assert kys_slam_run(sequence, *arguments) == 2
    error = capfd.readouterr().err
    assert what in error and error.count("\n") == 1


def test_a_network_runs_beside_the_tracker(sequence, tmp_path, capfd):
    """With a tiny network: twice, and from what it stored, the same bytes; its label space by itself."""
    pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    sys.path.insert(0, str(ROOT / "tests" / "priors"))
    from onnx_support import write_network
    model = write_network(tmp_path)
    options = ["--segment-every", 3, "--segment-lag", 2]
    texts = []
    for name, source in (("one", model), ("two", model), ("three", tmp_path / "one-priors")):
        assert kys_slam_run(sequence, "--segment", source, *options, "--output", tmp_path / name,
                            "--save-priors", tmp_path / f"{name}-priors") == 0, capfd.readouterr().err
        texts.append((tmp_path / name / "trajectory.tum").read_bytes())
    assert texts[0] == texts[1] == texts[2]
    assert len(list((tmp_path / "one-priors").glob("*.kysp"))) == 4
    assert "label_space: cityscapes_19" in (tmp_path / "one" / "config.yaml").read_text()


def test_prior_folder_of_make_priors(sequence, frames, tmp_path):
    """DIR with DIR/priors, in another label space than the default one."""
    city = kys_slam.LabelSpace("cityscapes_19")
    (tmp_path / "made" / "priors").mkdir(parents=True)
    for frame in frames:
        labels = np.full(frame.left.shape, city.ids[0])
        kys_slam.write_prior(tmp_path / "made" / "priors" / f"{frame.name}.kysp",
                             kys_slam.priors_from_labels(city, labels, labels))
    assert kys_slam_run(sequence, "--priors", tmp_path / "made", "--output", tmp_path / "out") == 0
    assert "label_space: cityscapes_19" in (tmp_path / "out" / "config.yaml").read_text()
    assert kys_slam_run(sequence, "--priors", tmp_path / "made", "--output", tmp_path / "other",
                        "--set", "control.label_space=coco_panoptic_133") == 2


def test_example_with_a_function_beside_the_tracker(sequence, monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    import live_segmentation
    live_segmentation.main(str(sequence))
    said = capsys.readouterr().out
    assert "frame 5: segments of frame 0" in said and "3 frames segmented, 12 tracked" in said
