# SPDX-License-Identifier: BSD-3-Clause
"""Recordings and the live view of Rerun (rerun-sdk)."""

import os
import sys
from pathlib import Path
from typing import Dict, List, Optional

import numpy as np

from ._core import InputError, StereoCamera
from .drawing import (
    FINAL, GRAPH, LOOP, TIER_COLOURS, TRACKED, EndDrawing, FrameDrawing, Sink, object_paths,
    quaternion)

_CAMERA, _IMAGE = "world/camera", "world/camera/image"
_SEGMENTS, _THINGS = _IMAGE + "/segments", _IMAGE + "/things"
_BATCH = 40  # frames that are written together
_PIECE = 200  # points of the path
_DOT = -1.5  # negative: px on the screen, not m


def _blueprint(rr):
    import rerun.blueprint as rrb
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(origin="world", name="map"),
            rrb.Vertical(
                rrb.Spatial2DView(origin=_IMAGE, name="left image"),
                rrb.TimeSeriesView(origin="counts", name="counts"),
                rrb.TimeSeriesView(origin="ms", name="ms per stage"),
                rrb.TextLogView(origin="events", name="events")),
            column_shares=[3, 2]),
        collapse_panels=True)


def has_display() -> bool:
    """Whether the viewer can open a window."""
    return bool(sys.platform != "linux" or os.environ.get("DISPLAY") or
                os.environ.get("WAYLAND_DISPLAY"))


class RerunSink(Sink):
    """Writes FILE.rrd; without a file it shows the run in Rerun's viewer: a window where there is
    a display, else a page in a browser."""

    def __init__(self, file: Optional[str]) -> None:
        try:
            import rerun
        except ImportError:
            raise InputError("--view and .rrd files need Rerun: pip install rerun-sdk") from None
        self.rr = rerun
        self.recording = rerun.RecordingStream("kys_slam")
        if file is not None:
            if not os.access(Path(file).resolve().parent, os.W_OK):
                raise InputError(f"cannot write {file}")
            self.recording.save(file, default_blueprint=_blueprint(rerun))
        elif has_display():
            self.recording.spawn(default_blueprint=_blueprint(rerun))
        else:
            address = self.recording.serve_grpc(default_blueprint=_blueprint(rerun))
            rerun.serve_web_viewer(open_browser=False, connect_to=address)
            print("no display here; the viewer is at http://localhost:9090/?url=" +
                  address.replace("+", "%2B"), file=sys.stderr, flush=True)
        self.batch = 1 if file is None else _BATCH
        self.waiting: List[FrameDrawing] = []
        self.shown: Dict[str, bool] = {}  # by entity, in the last frame that was sent
        self.path: List[np.ndarray] = []  # of the present piece
        self.pieces = 0  # that are complete

    def start(self, camera: StereoCamera) -> None:
        rr, log = self.rr, self.recording.log
        log("world", rr.ViewCoordinates.RDF, static=True)
        log(_IMAGE, rr.Pinhole(focal_length=(camera.fx, camera.fy),
                               principal_point=(camera.cx, camera.cy), width=camera.width,
                               height=camera.height, image_plane_distance=camera.baseline * 3),
            static=True)
        # What is the same for all frames.
        for entity, what in (
                (_SEGMENTS, rr.EncodedImage.from_fields(draw_order=1)),
                (_IMAGE + "/keypoints", rr.Points2D.from_fields(radii=2)),
                (_IMAGE + "/stereo", rr.LineStrips2D.from_fields(colors=(120, 190, 255, 90),
                                                                 radii=0.5)),
                (_CAMERA + "/points", rr.Points3D.from_fields(radii=_DOT))):
            log(entity, what, static=True)

    def frame(self, d: FrameDrawing) -> None:
        self.waiting.append(d)
        if len(self.waiting) >= self.batch:
            self._send_frames()

    def _send(self, entity: str, frames: List[FrameDrawing], columns, lengths=None) -> None:
        """Sends columns with one row per frame, of `lengths` values each; default one."""
        rr = self.rr
        self.recording.send_columns(
            entity, [rr.TimeColumn("frame", sequence=[d.index for d in frames]),
                     rr.TimeColumn("time", timestamp=[d.timestamp for d in frames])],
            columns if lengths is None else columns.partition(lengths))

    def _send_frames(self) -> None:
        """The frames that wait, together: a call per frame and entity costs more than the data."""
        rr, frames, self.waiting = self.rr, self.waiting, []
        if not frames:
            return
        pictures = [d for d in frames if d.jpeg is not None]
        if pictures:
            self._send(_IMAGE, pictures, self._images([d.jpeg for d in pictures], "image/jpeg"))
        self._send(_IMAGE + "/keypoints", frames, rr.Points2D.columns(
            positions=np.concatenate([d.keypoints for d in frames]),
            colors=TIER_COLOURS[np.concatenate([d.tiers for d in frames])]),
            [len(d.keypoints) for d in frames])
        self._send(_IMAGE + "/stereo", frames, rr.LineStrips2D.columns(
            strips=self._pairs(np.concatenate([d.stereo for d in frames]))),
            [len(d.stereo) for d in frames])
        self._send_things(frames)
        for name in frames[0].numbers:
            self._send(f"ms/{name[3:]}" if name.startswith("ms_") else f"counts/{name}", frames,
                       rr.Scalars.columns(scalars=[d.numbers[name] for d in frames]))
        posed = [d for d in frames if d.pose is not None]
        if posed:
            self._send(_CAMERA, posed, rr.Transform3D.columns(
                translation=[d.pose[:3, 3] for d in posed],
                quaternion=[quaternion(d.pose[:3, :3]) for d in posed]))
        keyframes = [d for d in posed if d.points is not None]
        if keyframes:
            self._send(_CAMERA + "/points", keyframes, rr.Points3D.columns(
                positions=np.concatenate([d.points for d in keyframes]),
                colors=np.concatenate([d.point_colours for d in keyframes])),
                [len(d.points) for d in keyframes])
        self._send_path(frames)
        for d in frames:
            if d.pose is None:
                self._log_event(d.index, d.timestamp, f"frame {d.index} {d.name} is lost")

    def _images(self, files: List[bytes], kind: str):
        # With each image: the viewer shows none while it streams where the kind stands apart.
        return self.rr.EncodedImage.columns(blob=files, media_type=[kind] * len(files))

    def _pairs(self, lines: np.ndarray):
        """(N, 2, 2) as line strips of two points; Rerun would go through them one by one."""
        import pyarrow
        kinds = self.rr.components, self.rr.encodings
        points = kinds[1].Vec2DBatch(lines.reshape(-1, 2)).as_arrow_array()
        return pyarrow.ListArray.from_arrays(
            np.arange(0, len(points) + 1, 2, dtype=np.int32), points,
            type=kinds[0].LineStrip2DBatch([]).as_arrow_array().type)

    def _send_things(self, frames: List[FrameDrawing]) -> None:
        """Segments and boxes, which not all frames have; what a frame does not have is cleared."""
        rr = self.rr
        for entity, there in ((_SEGMENTS, [d.segments is not None for d in frames]),
                              (_THINGS, [bool(d.boxes) for d in frames])):
            before = [self.shown.get(entity, False)] + there
            self.shown[entity] = there[-1]
            gone = [d for d, was, is_there in zip(frames, before, there) if was and not is_there]
            if gone:
                self._send(entity, gone, rr.Clear.columns(is_recursive=[False] * len(gone)))
        pictures = [d for d in frames if d.segments is not None]
        if pictures:
            self._send(_SEGMENTS, pictures, self._images([d.segments for d in pictures], "image/png"))
        boxed = [d for d in frames if d.boxes]
        if boxed:
            boxes = [b for d in boxed for b in d.boxes]
            low, high = np.array([b.low for b in boxes]), np.array([b.high for b in boxes])
            self._send(_THINGS, boxed, rr.Boxes2D.columns(
                centers=(low + high) / 2, half_sizes=(high - low) / 2,
                labels=[b.text for b in boxes], colors=[b.colour for b in boxes]),
                [len(d.boxes) for d in boxed])

    def _send_path(self, frames: List[FrameDrawing]) -> None:
        """The path in pieces, of which the last one grows with each keyframe."""
        drawn = []
        for d in frames:
            if d.pose is not None:
                self.path.append(d.pose[:3, 3])
            if d.points is not None and d.pose is not None:
                drawn.append((d, np.array(self.path)))
            if len(self.path) >= _PIECE or d is frames[-1]:
                if drawn:
                    self._send(f"world/path/tracked/{self.pieces}", [d for d, _ in drawn],
                               self.rr.LineStrips3D.columns(strips=[p for _, p in drawn],
                                                            colors=[TRACKED] * len(drawn)))
                drawn = []
            if len(self.path) >= _PIECE:
                self.pieces, self.path = self.pieces + 1, self.path[-1:]

    def _log_event(self, index: int, timestamp: float, text: str) -> None:
        self.recording.set_time("frame", sequence=index)
        self.recording.set_time("time", timestamp=timestamp)
        self.recording.log("events", self.rr.TextLog(text))

    def end(self, d: EndDrawing, classes: List[str]) -> None:
        self._send_frames()
        rr, log = self.rr, self.recording.log
        # Final poses, at the time of each frame.
        if len(d.poses):
            self.recording.reset_time()
            self.recording.send_columns(
                "world/final/camera", [rr.TimeColumn("time", timestamp=d.timestamps)],
                rr.Transform3D.columns(
                    translation=d.poses[:, :3, 3],
                    quaternion=[quaternion(pose[:3, :3]) for pose in d.poses]))
            self.recording.set_time("time", timestamp=float(d.timestamps[-1]))
        log("world/final/path", rr.LineStrips3D([d.poses[:, :3, 3]], colors=FINAL))
        log("world/final/landmarks", rr.Points3D(d.points, colors=d.colours, radii=_DOT))
        log("world/final/keyframes", rr.LineStrips3D(d.graph, colors=GRAPH))
        log("world/final/loops", rr.LineStrips3D(d.loop_edges, colors=LOOP, radii=0.03))
        if d.objects is not None:
            for name, path in object_paths(d.objects, classes):
                log(f"world/final/objects/{name}", rr.LineStrips3D([path], colors=LOOP))
        for loop in d.loops:
            self._log_event(loop.frame, loop.timestamp,
                            f"loop {loop.kind}: frame {loop.frame} with {loop.other}, "
                            f"{loop.gap_m:.3f} m open")
            if loop.line is not None:
                log("world/loop", rr.LineStrips3D([loop.line], colors=LOOP, radii=0.05))

    def close(self) -> None:
        self._send_frames()
        self.recording.flush()
        self.recording.disconnect()
