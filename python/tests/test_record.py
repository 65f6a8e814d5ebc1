# SPDX-License-Identifier: BSD-3-Clause
"""Recordings for viewers say what the files of the run say."""

import csv
import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest

import kys_slam
from conftest import ROOT, run_program
from kys_slam import cli
from kys_slam.drawing import (
    Segments, belief_colour, class_colours, encode_png, quaternion, segment_picture)
from kys_slam.priors import RIGHT_INSTANCES, SEGMENT, THING, PriorCamera, encode_prior
from kys_slam.record import open_recorder

WORLDS = Path(os.environ.get("KYS_WORLDS", ROOT / "build/release/regression/data"))
COUNTS = ("keypoints", "stereo_matches", "matches", "inliers", "masked")


def record(folder, arguments, *files):
    options = [option for file in files for option in ("--record", str(folder / file))]
    assert cli.main(["run", *map(str, arguments), "--output", str(folder / "run"), "--quiet",
                     *options]) == 0
    return folder


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """A world with a loop, recorded in every way that can be here."""
    world = next(WORLDS.glob("block-414x126-*-1-images"), None)
    if world is None:
        pytest.skip(f"no block in {WORLDS}")
    files = []
    try:
        import mcap_protobuf  # noqa: F401
        files.append("run.mcap")
    except ImportError:
        pass
    try:
        import rerun  # noqa: F401
        files.append("run.rrd")
    except ImportError:
        pass
    return record(tmp_path_factory.mktemp("block"), [world], *files), world


@pytest.fixture(scope="module")
def truth(block):
    """What the run's own files say: rows of frames.csv, times and poses of trajectory.tum."""
    run = block[0] / "run"
    with open(run / "frames.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    return rows, kys_slam.read_tum(run / "trajectory.tum")


def loops_of(rows):
    return [(int(r["index"]), int(r["loop_frame"])) for r in rows if r["loop"]]


def test_recording_changes_nothing(block, tmp_path):
    folder, world = block
    run_program("run_stereo_kitti", world, "--output", tmp_path, "--quiet")
    for name in ("trajectory.tum", "map.ply", "graph.csv"):
        assert (folder / "run" / name).read_bytes() == (tmp_path / name).read_bytes()


def read_mcap(file):
    """[(time ns, message)] by topic."""
    reader_module = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_protobuf.decoder").DecoderFactory()
    messages = {}
    with open(file, "rb") as stream:
        for schema, channel, message in reader_module.make_reader(stream).iter_messages():
            value = (json.loads(message.data) if channel.message_encoding == "json" else
                     decoder.decoder_for("protobuf", schema)(message.data))
            messages.setdefault(channel.topic, []).append((message.log_time, value))
    return messages


def test_mcap_reads_back(block, truth):
    rows, (times, poses) = truth
    messages = read_mcap(block[0] / "run.mcap")
    final = messages["/pose/final"]
    assert [t for t, _ in final] == [round(t * 1e9) for t in times]
    for (_, message), pose in zip(final, poses):
        p, q = message.pose.position, message.pose.orientation
        assert np.abs(np.array([p.x, p.y, p.z]) - pose[:3, 3]).max() < 1e-8
        assert np.abs(np.array([q.x, q.y, q.z, q.w]) - quaternion(pose[:3, :3])).max() < 1e-8
    frames = [value for _, value in messages["/frame"]]
    assert len(frames) == len(rows)
    for frame, row in zip(frames, rows):
        assert [frame[key] for key in COUNTS] == [int(row[key]) for key in COUNTS]
        assert (frame["name"], frame["status"]) == (row["name"], row["status"])
    tracked = [row for row in rows if row["status"] == "tracked"]
    covariances = [value for _, value in messages["/pose/covariance"]]
    assert [c["index"] for c in covariances] == [int(row["index"]) for row in tracked]
    for c in covariances:
        full = np.reshape(c["local"]["covariance"], (6, 6))
        assert np.array_equal(full, full.T) and np.linalg.eigvalsh(full).min() > 0
    sigmas = [frame["sigma_local_m"] for frame in frames if frame["status"] == "tracked"]
    expected = [np.sqrt(np.trace(np.reshape(c["local"]["covariance"], (6, 6))[3:, 3:]))
                for c in covariances]
    assert np.allclose(sigmas, expected)
    loops = [(value["frame"], value["other"]) for _, value in messages["/loops"]]
    assert loops and loops == loops_of(rows)
    assert messages["/scene/loops"][0][1].entities[0].lines[0].points
    # Before and after the loop's correction: tracked and final paths part.
    tracked = np.array([(m.pose.position.x, m.pose.position.y, m.pose.position.z)
                        for _, m in messages["/pose/tracked"]])
    assert len(tracked) == sum(row["status"] != "lost" for row in rows)
    assert np.linalg.norm(tracked - poses[:, :3, 3], axis=1).max() > 0.01
    image = messages["/camera/image"][0][1]
    decoded = kys_slam._core.decode_gray(image.data, "image")
    camera = kys_slam.open_sequence(block[1]).camera
    assert decoded.shape == (camera.height, camera.width)
    cloud = messages["/map"][0][1]
    kinds = {1: "u1", 6: "<i4", 7: "<f4"}
    table = np.frombuffer(cloud.data, np.dtype(
        {"names": [f.name for f in cloud.fields], "formats": [kinds[f.type] for f in cloud.fields],
         "offsets": [f.offset for f in cloud.fields], "itemsize": cloud.point_stride}))
    landmarks = kys_slam.read_map(block[0] / "run" / "map.ply")
    for name in ("x", "y", "z", "red", "class", "instance", "belief", "observations"):
        assert np.array_equal(table[name], landmarks.points[name])


def test_rrd_reads_back(block, truth):
    chunk = pytest.importorskip("rerun.chunk")
    rows, (times, poses) = truth
    columns = {}
    for part in chunk.RrdReader(block[0] / "run.rrd").stream().to_chunks():
        batch = part.to_record_batch()
        for name in batch.schema.names:
            column = columns.setdefault((part.entity_path, name), [])
            column.extend(v.value if hasattr(v, "value") else v.as_py() for v in batch.column(name)) \
                if name in ("time", "log_time") else column.extend(batch.column(name).to_pylist())

    def values(entity, name):
        """Of an entity over time, in order of frames."""
        found = [key for key in columns if key[0] == entity and key[1].endswith(name)]
        assert len(found) == 1, (entity, name, found)
        stamps = columns[(entity, "time")]
        return [v for _, v in sorted(zip(stamps, columns[found[0]]), key=lambda pair: pair[0])]

    position = np.array(values("/world/final/camera", "translation")).reshape(-1, 3)
    rotation = np.array(values("/world/final/camera", "quaternion")).reshape(-1, 4)
    assert len(position) == len(times)
    assert np.abs(position - poses[:, :3, 3]).max() < 1e-4  # float32 in Rerun, path of 200 m
    turns = np.array([quaternion(p[:3, :3]) for p in poses])
    assert np.abs(np.abs((rotation * turns).sum(axis=1)) - 1).max() < 1e-6
    for key in COUNTS:
        recorded = np.array(values(f"/counts/{key}", "scalars")).ravel()
        assert recorded.tolist() == [float(row[key]) for row in rows]
    loops = [f"frame {a} with {b}" for a, b in loops_of(rows)]
    events = [text for entry in values("/events", "text") for text in entry if "loop" in text]
    assert len(events) == len(loops) and all(l in e for l, e in zip(loops, events))
    assert columns[("/world/loop", "LineStrips3D:strips")]
    assert len(values("/world/camera/image", "blob")) == len(rows)


def test_quaternions():
    rng = np.random.default_rng(3)
    for q in [*np.eye(4), *rng.normal(size=(50, 4))]:
        x, y, z, w = q / np.linalg.norm(q)
        r = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                      [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                      [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
        assert abs(abs(quaternion(r) @ (x, y, z, w)) - 1) < 1e-12


def test_wrong_recordings_say_so(tmp_path, corridor_camera):
    slam = kys_slam.System(corridor_camera)
    with pytest.raises(kys_slam.InputError, match="rrd or FILE.mcap"):
        open_recorder(tmp_path / "run.avi", slam)
    for name in ("run.mcap", "run.rrd"):
        pytest.importorskip("mcap_protobuf" if name == "run.mcap" else "rerun")
        with pytest.raises(kys_slam.InputError, match="cannot write"):
            open_recorder(tmp_path / "no" / name, slam)


def test_a_full_disk_costs_the_recording_alone(corridor, corridor_camera):
    pytest.importorskip("mcap_protobuf")
    link = Path("/dev/full")
    if not link.exists():
        pytest.skip("no /dev/full")
    slam = kys_slam.System(corridor_camera, {"orb.features": 600})
    # A file whose name ends as it has to, on a full device.
    folder = Path(os.environ.get("TMPDIR", "/tmp")) / f"kys_full_{os.getpid()}"
    folder.mkdir()
    try:
        (folder / "run.mcap").symlink_to(link)
        recorder = open_recorder(folder / "run.mcap", slam)
        for left, right, time, _ in corridor:
            slam.feed(left, right, time)
        slam.finish()
        with pytest.raises(kys_slam.InputError, match="cannot be written"):
            recorder.close()
        assert len(slam.trajectory().timestamps) == len(corridor)
    finally:
        (folder / "run.mcap").unlink()
        folder.rmdir()


def test_interrupted_close_ends_the_process(tmp_path, corridor, corridor_camera, monkeypatch):
    """Ctrl-C between the last frame and the end of the recording."""
    pytest.importorskip("mcap_protobuf")
    slam = kys_slam.System(corridor_camera, {"orb.features": 600})
    recorder = open_recorder(tmp_path / "run.mcap", slam)
    slam.feed(*corridor[0][:3])
    slam.finish()

    def interrupt(*_):
        raise KeyboardInterrupt

    def late(*_):
        recorder._child.kill()
        raise TimeoutError

    monkeypatch.setattr(recorder, "_send", interrupt)
    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(20)
    try:
        with pytest.raises(KeyboardInterrupt):
            recorder.close()
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    assert recorder._child.poll() is not None


def test_image_that_cannot_be_encoded_costs_the_recording_alone(tmp_path, corridor, corridor_camera,
                                                                monkeypatch):
    pytest.importorskip("mcap_protobuf")
    slam = kys_slam.System(corridor_camera, {"orb.features": 600})
    monkeypatch.setattr("kys_slam.record._JPEG_QUALITY", 101)  # there is none
    recorder = open_recorder(tmp_path / "run.mcap", slam)
    for left, right, time, _ in corridor[:3]:
        slam.feed(left, right, time)
    slam.finish()
    with pytest.raises(kys_slam.InputError, match="run.mcap: frames are missing: JPEG"):
        recorder.close()
    assert len(slam.trajectory().timestamps) == 3
    messages = read_mcap(tmp_path / "run.mcap")  # what came before and the end are there
    assert "/frame" not in messages and len(messages["/pose/final"]) == 3


def test_segments_given_with_a_frame_are_recorded(tmp_path, corridor, corridor_camera):
    """A thing that moves is red in the picture of the segments, one that stands still green."""
    cv2 = pytest.importorskip("cv2")
    pytest.importorskip("mcap_protobuf")
    space = kys_slam.LabelSpace("coco_panoptic_133")
    car, road = space.names.index("car"), space.names.index("road")
    table = np.zeros(3, SEGMENT)
    table["label"], table["flags"] = [car, car, road], [THING | 2, THING, 0]  # 2: DYNAMIC
    table["instance"], table["score"], table["scale"] = [1, 2, 3], [100, 0, 0], 1000
    right = table.copy()
    right["instance"] += RIGHT_INSTANCES
    height, width = corridor_camera.height, corridor_camera.width
    where = np.zeros((height, width), np.uint16)
    where[10:40, 20:60], where[10:40, 100:150], where[150:, :] = 1, 2, 3
    motion = np.where(where == 1, 100, 0).astype(np.float32)
    frame = kys_slam.PriorFrame("coco_panoptic_133", [
        PriorCamera(table, where, motion), PriorCamera(right, where, motion)], has_motion=True)
    slam = kys_slam.System(corridor_camera, {"orb.features": 600, "kys.mode": "verified"})
    recorder = open_recorder(tmp_path / "run.mcap", slam)
    for left, right, time, _ in corridor:
        slam.feed(left, right, time, segments=frame)
    slam.finish()
    recorder.close()
    messages = read_mcap(tmp_path / "run.mcap")
    assert len(messages["/camera/segments"]) == len(corridor)
    picture = cv2.imdecode(np.frombuffer(messages["/camera/segments"][0][1].data, np.uint8),
                           cv2.IMREAD_UNCHANGED)  # BGRA
    assert picture.shape == (height, width, 4)
    moving, still = picture[20, 30], picture[20, 120]
    assert moving[2] > 200 > moving[1] and moving[3] > 100
    assert still[1] > 150 > still[2] and picture[100, 100, 3] == 0
    assert picture[200, 200, 3] > 0
    texts = [t.text for t in messages["/camera/annotations"][0][1].texts]
    assert any(t.startswith("car 1, moving") for t in texts)
    assert any(t.startswith("car 2, moving 0.") for t in texts)


def test_pictures_of_many_segments():
    """More colours than a palette has are still a sound picture."""
    cv2 = pytest.importorskip("cv2")
    table = np.zeros(400, SEGMENT)
    table["label"] = np.arange(400)
    where = np.arange(401, dtype=np.uint16).repeat(5).reshape(5, 401)
    picture = cv2.imdecode(np.frombuffer(segment_picture(
        Segments(table, where, np.zeros((400, 4))), np.full(400, np.nan)), np.uint8),
        cv2.IMREAD_UNCHANGED)
    assert picture.shape == (5, 401, 4)
    assert belief_colour(1.0) == (230, 50, 50) and belief_colour(0.0) == (70, 220, 90)


@pytest.mark.parametrize("colours, width", [(3, 7), (16, 8), (17, 7)])
def test_pictures_have_the_pixels_they_are_made_of(colours, width):
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(5)
    palette = rng.integers(0, 256, (colours, 4), np.uint8)
    pixels = rng.integers(0, colours, (6, width), np.uint8)
    picture = cv2.imdecode(np.frombuffer(encode_png(pixels, palette), np.uint8),
                           cv2.IMREAD_UNCHANGED)  # BGRA
    assert np.array_equal(picture[..., [2, 1, 0, 3]], palette[pixels])


def test_segments_are_those_of_the_prior_file():
    table = np.zeros(3, SEGMENT)
    table["label"], table["flags"] = [2, 3, 4], [THING, THING, 0]
    table["instance"] = [7, 8, 9]
    where = np.zeros((9, 12), np.uint16)
    where[2:5, 3:8], where[4, 6:11], where[8, 0] = 1, 2, 1
    frame = kys_slam.PriorFrame("coco_panoptic_133", [PriorCamera(table, where)])
    drawn = Segments.decode(encode_prior(frame))
    assert np.array_equal(drawn.segment_map, where)
    assert drawn.segments["area"].tolist() == [14, 5, 0]
    assert drawn.boxes.tolist() == [[0, 2, 8, 9], [6, 4, 11, 5], [0, 0, 0, 0]]


def test_points_of_messages_are_those_added_one_by_one():
    module = pytest.importorskip("foxglove_schemas_protobuf.PointsAnnotation_pb2")
    from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
    from kys_slam.record_mcap import _add_points
    rng = np.random.default_rng(6)
    for kind, values in ((module.PointsAnnotation, rng.normal(size=(50, 2))),
                         (LinePrimitive, rng.normal(size=(50, 3)))):
        ours, theirs = kind(), kind()
        _add_points(ours, values)
        for row in values.tolist():
            theirs.points.add(**dict(zip("xyz", row)))
        assert ours == theirs
        assert ours.SerializeToString() == theirs.SerializeToString()


@pytest.mark.parametrize("kind, package", [("mcap", "mcap_protobuf"), ("rrd", "rerun")])
def test_frames_without_anything_to_see_are_recorded(tmp_path, corridor, corridor_camera, kind,
                                                     package):
    """Frames without keypoints, without a pose, without an image."""
    pytest.importorskip(package)
    slam = kys_slam.System(corridor_camera, {"orb.features": 600})
    recorders = [open_recorder(tmp_path / f"run.{kind}", slam),
                 open_recorder(tmp_path / f"bare.{kind}", slam, images=False)]
    black = np.zeros((corridor_camera.height, corridor_camera.width), np.uint8)
    for i, (left, right, time, _) in enumerate(corridor):
        slam.feed(*((left, right) if i < 6 else (black, black)), time)
    assert sum(r.lost for r in slam.reports()) > 0
    slam.finish()
    for recorder in recorders:
        recorder.close()
        assert recorder.drawing_s > 0
    assert (tmp_path / f"bare.{kind}").stat().st_size < (tmp_path / f"run.{kind}").stat().st_size
    if kind == "mcap":
        messages = read_mcap(tmp_path / "run.mcap")
        assert len(messages["/frame"]) == len(messages["/camera/image"]) == len(corridor)
        assert len(messages["/log"]) >= sum(r.lost for r in slam.reports())
        assert "/camera/image" not in read_mcap(tmp_path / "bare.mcap")


def test_observers_and_recorders_go_together(tmp_path, corridor, corridor_camera):
    """An observer that asks for reports, and puts itself out, beside a recording."""
    pytest.importorskip("mcap_protobuf")
    slam = kys_slam.System(corridor_camera, {"orb.features": 600})
    recorder, told = open_recorder(tmp_path / "run.mcap", slam), []

    def observer(seen):
        told.append(len(slam.reports()))
        if len(told) == 3:
            slam.set_observer(None)

    slam.set_observer(observer)
    for left, right, time, _ in corridor:
        slam.feed(left, right, time)
    slam.finish()
    recorder.close()
    recorder.close()  # does nothing
    assert told == [1, 2, 3]
    assert len(read_mcap(tmp_path / "run.mcap")["/frame"]) == len(corridor)


def test_map_of_the_street_has_the_simulators_classes(tmp_path):
    """The class of a landmark is that of the simulator's picture where the landmark is seen."""
    cv2 = pytest.importorskip("cv2")
    street = WORLDS / "street-620x188-80-1"
    if not street.is_dir():
        pytest.skip(f"no street in {WORLDS}")
    run_program("run_stereo_kitti", street, "--priors", f"{street}-priors", "--output", tmp_path,
                "--quiet")
    landmarks = kys_slam.read_map(tmp_path / "map.ply")
    camera = kys_slam.open_sequence(street).camera
    index_of = {i: k for k, i in enumerate(kys_slam.LabelSpace(landmarks.label_space).ids)}
    segments = json.loads((street / "panoptic_left.json").read_text())
    annotations = {Path(a["file_name"]).stem: a["segments_info"] for a in segments["annotations"]}
    times, poses = kys_slam.read_tum(tmp_path / "trajectory.tum")
    stamps = np.loadtxt(street / "times.txt")
    votes = np.zeros((len(landmarks.points), 2), int)  # agree, differ
    p_w = np.stack([landmarks.points[k] for k in "xyz"], axis=-1).astype(float)
    for time, pose in zip(times, poses):
        name = f"{np.abs(stamps - time).argmin():06d}"
        p = (p_w - pose[:3, 3]) @ pose[:3, :3]
        seen = p[:, 2] > 0.5
        u = np.rint(camera.fx * p[:, 0] / np.where(seen, p[:, 2], 1) + camera.cx).astype(int)
        v = np.rint(camera.fy * p[:, 1] / np.where(seen, p[:, 2], 1) + camera.cy).astype(int)
        seen &= (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
        u, v, k = u[seen], v[seen], np.flatnonzero(seen)
        disparity = cv2.imread(str(street / "disparity" / f"{name}.png"), -1)[v, u] / 256.0
        own = camera.fx * camera.baseline / p[k, 2]
        there = np.abs(disparity - own) < 0.5  # px: not hidden by something nearer
        u, v, k = u[there], v[there], k[there]
        rgb = cv2.imread(str(street / "panoptic_left" / f"{name}.png"))[v, u].astype(int)
        segment = rgb[:, 2] + 256 * rgb[:, 1] + 65536 * rgb[:, 0]
        category = {s["id"]: index_of[s["category_id"]] for s in annotations[name]}
        label = np.array([category.get(int(s), -1) for s in segment])
        agree = label == landmarks.points["class"][k]
        np.add.at(votes, (k, np.where(agree, 0, 1)), 1)
    judged = votes.sum(axis=1) > 0
    share = np.mean(votes[judged, 0] >= votes[judged, 1])
    print(f"{judged.sum()} of {len(judged)} landmarks seen, {100 * share:.1f} % agree")
    assert judged.mean() > 0.8
    assert share >= 0.95
    colours = np.stack([landmarks.points[c] for c in ("red", "green", "blue")], axis=-1)
    assert np.array_equal(colours, class_colours(landmarks.points["class"].astype(np.uint16)))
    assert set(landmarks.points["class"].tolist()) - {-1} == set(landmarks.classes)


def test_open3d_reads_the_map(block):
    open3d = pytest.importorskip("open3d")
    file = block[0] / "run" / "map.ply"
    cloud, landmarks = open3d.t.io.read_point_cloud(str(file)), kys_slam.read_map(file).points
    assert np.array_equal(cloud.point["class"].numpy().ravel(), landmarks["class"])
    assert np.array_equal(cloud.point.positions.numpy()[:, 0], landmarks["x"])
