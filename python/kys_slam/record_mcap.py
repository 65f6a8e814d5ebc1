# SPDX-License-Identifier: BSD-3-Clause
"""MCAP files with Foxglove's schemas; numbers and loops as JSON."""

import json
from typing import List

import numpy as np

from ._core import InputError, StereoCamera, __version__
from .drawing import (
    FINAL, GRAPH, LOOP, TIER_COLOURS, TRACKED, EndDrawing, FrameDrawing, Sink, object_paths,
    quaternion)
from .kysp import VOID_LABEL

_WORLD, _CAMERA = "world", "camera"
_NUMBER = {"type": "number"}
_REPORT = {"title": "kys_slam.Frame", "type": "object", "additionalProperties": _NUMBER,
           "properties": {"index": _NUMBER, "name": {"type": "string"},
                          "status": {"type": "string"}}}
_NUMBERS = {"type": "array", "items": _NUMBER}
_RELATIVE = {"type": "object", "properties": {"other": _NUMBER, "pose": _NUMBERS,
                                              "covariance": _NUMBERS}}
_COVARIANCE = {"title": "kys_slam.Covariance", "type": "object",
               "properties": {"index": _NUMBER, "local": _RELATIVE, "motion": _RELATIVE}}
_LOOP = {"title": "kys_slam.Loop", "type": "object",
         "properties": {"frame": _NUMBER, "other": _NUMBER, "kind": {"type": "string"},
                        "gap_m": _NUMBER}}


def _nanoseconds(timestamp: float) -> int:
    return max(0, int(round(timestamp * 1e9)))


class McapSink(Sink):
    """Writes FILE.mcap."""

    def __init__(self, file: str) -> None:
        try:
            from foxglove_schemas_protobuf import (
                CameraCalibration_pb2, CompressedImage_pb2, FrameTransform_pb2,
                ImageAnnotations_pb2, Log_pb2, PointCloud_pb2, PoseInFrame_pb2, SceneUpdate_pb2)
            from mcap.writer import CompressionType, Writer
            from mcap_protobuf.schema import register_schema
        except ImportError:
            raise InputError(".mcap files need pip install mcap-protobuf-support "
                             "foxglove-schemas-protobuf") from None
        self.pb = {name: getattr(module, name) for name, module in {
            "CameraCalibration": CameraCalibration_pb2, "CompressedImage": CompressedImage_pb2,
            "FrameTransform": FrameTransform_pb2, "ImageAnnotations": ImageAnnotations_pb2,
            "Log": Log_pb2, "PointCloud": PointCloud_pb2, "PoseInFrame": PoseInFrame_pb2,
            "SceneUpdate": SceneUpdate_pb2}.items()}
        try:
            self.stream = open(file, "wb")
        except OSError as error:
            raise InputError(f"cannot write {file}: {error.strerror}") from None
        self.writer = Writer(self.stream, compression=CompressionType.LZ4)
        self.writer.start(library=f"kys-slam {__version__}")
        self.schemas = {kind: register_schema(self.writer, kind) for kind in self.pb.values()}
        for schema in (_REPORT, _COVARIANCE, _LOOP):
            self.schemas[schema["title"]] = self.writer.register_schema(
                schema["title"], "jsonschema", json.dumps(schema).encode())
        self.channels = {}
        self.camera = None

    def start(self, camera: StereoCamera) -> None:
        self.camera = camera

    def _new(self, name: str, timestamp: float, frame: str = ""):
        message = self.pb[name]()
        message.timestamp.FromNanoseconds(_nanoseconds(timestamp))
        if frame:
            message.frame_id = frame
        return message

    def _add(self, topic: str, timestamp: float, encoding: str, schema, data: bytes) -> None:
        if topic not in self.channels:
            self.channels[topic] = self.writer.register_channel(topic, encoding,
                                                                self.schemas[schema])
        at = _nanoseconds(timestamp)
        self.writer.add_message(self.channels[topic], at, data, at)

    def _write(self, topic: str, timestamp: float, message) -> None:
        self._add(topic, timestamp, "protobuf", type(message), message.SerializeToString())

    def _write_json(self, topic: str, schema: dict, timestamp: float, value: dict) -> None:
        self._add(topic, timestamp, "json", schema["title"], json.dumps(value).encode())

    def _pose(self, topic: str, timestamp: float, pose: np.ndarray) -> None:
        message = self._new("PoseInFrame", timestamp, _WORLD)
        p, q = message.pose.position, message.pose.orientation
        p.x, p.y, p.z = pose[:3, 3].tolist()
        q.x, q.y, q.z, q.w = quaternion(pose[:3, :3]).tolist()
        self._write(topic, timestamp, message)

    def _cloud(self, topic: str, timestamp: float, frame: str, table: np.ndarray) -> None:
        message = self._new("PointCloud", timestamp, frame)
        message.pose.orientation.w = 1
        types = {"u1": 1, "i4": 6, "f4": 7}  # PackedElementField.NumericType
        for name in table.dtype.names:
            kind, offset = table.dtype.fields[name][:2]
            message.fields.add(name=name, offset=offset, type=types[kind.str[1:]])
        message.point_stride = table.dtype.itemsize
        message.data = table.tobytes()
        self._write(topic, timestamp, message)

    def frame(self, d: FrameDrawing) -> None:
        t, c = d.timestamp, self.camera
        if d.jpeg is not None:
            calibration = self._new("CameraCalibration", t, _CAMERA)
            calibration.width, calibration.height = c.width, c.height
            calibration.K.extend([c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1])
            calibration.P.extend([c.fx, 0, c.cx, 0, 0, c.fy, c.cy, 0, 0, 0, 1, 0])
            self._write("/camera/calibration", t, calibration)
            image = self._new("CompressedImage", t, _CAMERA)
            image.format, image.data = "jpeg", d.jpeg
            self._write("/camera/image", t, image)
        if d.segments is not None:
            image = self._new("CompressedImage", t, _CAMERA)
            image.format, image.data = "png", d.segments
            self._write("/camera/segments", t, image)
        self._annotate(d)
        numbers = {name: value for name, value in d.numbers.items() if np.isfinite(value)}
        self._write_json("/frame", _REPORT, t, {"index": d.index, "name": d.name,
                                                "status": d.status, **numbers})
        if d.relative:
            self._write_json("/pose/covariance", _COVARIANCE, t, {"index": d.index, **d.relative})
        if d.pose is None:
            self._log(t, f"frame {d.index} {d.name} is lost")
            return
        self._pose("/pose/tracked", t, d.pose)
        transform = self._new("FrameTransform", t)
        transform.parent_frame_id, transform.child_frame_id = _WORLD, _CAMERA
        v, q = transform.translation, transform.rotation
        v.x, v.y, v.z = d.pose[:3, 3].tolist()
        q.x, q.y, q.z, q.w = quaternion(d.pose[:3, :3]).tolist()
        self._write("/tf", t, transform)
        if d.points is not None:
            self._cloud("/points", t, _CAMERA, _table(d.points, d.point_colours))

    def _annotate(self, d: FrameDrawing) -> None:
        message = self.pb["ImageAnnotations"]()
        for tier in np.flatnonzero(np.bincount(d.tiers)):
            points = message.points.add(type=1, thickness=3)  # POINTS
            points.timestamp.FromNanoseconds(_nanoseconds(d.timestamp))
            _set_colour(points.outline_color, TIER_COLOURS[tier])
            _add_points(points, d.keypoints[d.tiers == tier])
        if len(d.stereo):
            lines = message.points.add(type=4, thickness=0.5)  # LINE_LIST
            lines.timestamp.FromNanoseconds(_nanoseconds(d.timestamp))
            _set_colour(lines.outline_color, (120, 190, 255), 0.35)
            _add_points(lines, d.stereo.reshape(-1, 2))
        for box in d.boxes:
            (x0, y0), (x1, y1) = box.low.tolist(), box.high.tolist()
            outline = message.points.add(type=2, thickness=2)  # LINE_LOOP
            text = message.texts.add(text=box.text, font_size=12)
            for item in (outline, text):
                item.timestamp.FromNanoseconds(_nanoseconds(d.timestamp))
            _set_colour(outline.outline_color, box.colour)
            _set_colour(text.text_color, (255, 255, 255))
            _set_colour(text.background_color, box.colour, 0.6)
            text.position.x, text.position.y = x0, y0
            _add_points(outline, np.array(((x0, y0), (x1, y0), (x1, y1), (x0, y1))))
        self._write("/camera/annotations", d.timestamp, message)

    def _log(self, timestamp: float, text: str) -> None:
        message = self._new("Log", timestamp)
        message.level, message.message, message.name = 2, text, "kys_slam"  # INFO
        self._write("/log", timestamp, message)

    def _lines(self, name: str, timestamp: float, points: np.ndarray, colour, strip: bool) -> None:
        if len(points) < 2:
            return
        message = self.pb["SceneUpdate"]()
        entity = message.entities.add(id=name, frame_id=_WORLD)
        entity.timestamp.FromNanoseconds(_nanoseconds(timestamp))
        line = entity.lines.add(type=0 if strip else 2, thickness=2, scale_invariant=True)
        line.pose.orientation.w = 1
        _set_colour(line.color, colour)
        _add_points(line, points.reshape(-1, 3))
        self._write(f"/scene/{name}", timestamp, message)

    def end(self, d: EndDrawing, classes: List[str]) -> None:
        for timestamp, pose in zip(d.timestamps, d.poses):
            self._pose("/pose/final", timestamp, pose)
        t = float(d.timestamps[-1]) if len(d.timestamps) else 0.0
        self._lines("tracked", t, d.tracked, TRACKED, True)
        self._lines("final", t, d.poses[:, :3, 3], FINAL, True)
        self._lines("keyframes", t, d.graph.reshape(-1, 3), GRAPH, False)
        self._lines("loops", t, d.loop_edges.reshape(-1, 3), LOOP, False)
        s = d.snapshot
        label = s.landmark_labels[d.own].astype(np.int32)
        label[label == VOID_LABEL] = -1
        self._cloud("/map", t, _WORLD, _table(
            d.points, d.colours, {"class": ("<i4", label),
                                  "instance": ("<i4", s.landmark_instances[d.own]),
                                  "belief": ("<f4", s.landmark_beliefs[d.own]),
                                  "observations": ("<i4", s.landmark_observations[d.own])}))
        if d.objects is not None:
            for name, path in object_paths(d.objects, classes):
                self._lines(f"objects/{name}", t, path, LOOP, True)
        for loop in d.loops:
            self._write_json("/loops", _LOOP, loop.timestamp, {
                "frame": loop.frame, "other": loop.other, "kind": loop.kind, "gap_m": loop.gap_m})
            self._log(loop.timestamp, f"loop {loop.kind}: frame {loop.frame} with {loop.other}, "
                                      f"{loop.gap_m:.3f} m open")

    def close(self) -> None:
        self.writer.finish()
        self.stream.close()


def _table(points: np.ndarray, colours: np.ndarray, more=None) -> np.ndarray:
    """Points, their colours and further columns {name: (type, values)} as one packed table."""
    columns = {"x": ("<f4", points[:, 0]), "y": ("<f4", points[:, 1]), "z": ("<f4", points[:, 2])}
    for i, name in enumerate(("red", "green", "blue")):
        columns[name] = ("u1", colours[:, i])
    columns["alpha"] = ("u1", np.full(len(points), 255, np.uint8))
    columns.update(more or {})
    table = np.empty(len(points), [(name, kind) for name, (kind, _) in columns.items()])
    for name, (_, values) in columns.items():
        table[name] = values
    return table


def _add_points(message, points: np.ndarray) -> None:
    """Adds (N, 2) or (N, 3) coordinates to the field `points` of a message, as add() one by one would:
    thousands per frame are too many for that. A point is a message of doubles x, y (, z)."""
    number = message.DESCRIPTOR.fields_by_name["points"].number
    axes = "xyz"[:points.shape[1]]
    rows = np.empty(len(points), [("tag", "u1"), ("size", "u1")] +
                    [item for a in axes for item in ((f"tag_{a}", "u1"), (a, "<f8"))])
    rows["tag"], rows["size"] = number << 3 | 2, rows.dtype.itemsize - 2  # 2: a message of `size` bytes
    for i, a in enumerate(axes):
        rows[f"tag_{a}"], rows[a] = (i + 1) << 3 | 1, points[:, i]  # 1: 8 bytes
    message.MergeFromString(rows.tobytes())


def _set_colour(message, rgb, alpha: float = 1.0) -> None:
    message.r, message.g, message.b = (float(v) / 255 for v in rgb)
    message.a = alpha
