"""Recordings and the live view of Rerun (rerun-sdk)."""

import os
import sys
from pathlib import Path
from typing import List, Optional

import numpy as np

from ._core import InputError, StereoCamera
from .drawing import FINAL, GRAPH, LOOP, TRACKED, EndDrawing, FrameDrawing, Sink, quaternion

_CAMERA, _IMAGE = "world/camera", "world/camera/image"
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
        elif sys.platform != "linux" or os.environ.get("DISPLAY") or \
                os.environ.get("WAYLAND_DISPLAY"):
            self.recording.spawn(default_blueprint=_blueprint(rerun))
        else:
            address = self.recording.serve_grpc(default_blueprint=_blueprint(rerun))
            rerun.serve_web_viewer(open_browser=False, connect_to=address)
            print("no display here; the viewer is at http://localhost:9090/?url=" +
                  address.replace("+", "%2B"), file=sys.stderr, flush=True)
        self.path: List[np.ndarray] = []

    def start(self, camera: StereoCamera) -> None:
        rr, log = self.rr, self.recording.log
        log("world", rr.ViewCoordinates.RDF, static=True)
        log(_IMAGE, rr.Pinhole(focal_length=(camera.fx, camera.fy),
                               principal_point=(camera.cx, camera.cy), width=camera.width,
                               height=camera.height, image_plane_distance=camera.baseline * 3),
            static=True)

    def _transform(self, pose: np.ndarray):
        return self.rr.Transform3D(translation=pose[:3, 3],
                                   quaternion=quaternion(pose[:3, :3]))

    def frame(self, d: FrameDrawing) -> None:
        rr, log = self.rr, self.recording.log
        self.recording.set_time("frame", sequence=d.index)
        self.recording.set_time("time", timestamp=d.timestamp)
        if d.jpeg is not None:
            log(_IMAGE, rr.EncodedImage(contents=d.jpeg, media_type="image/jpeg"))
        if d.segments is not None:
            log(_IMAGE + "/segments", rr.EncodedImage(contents=d.segments, media_type="image/png",
                                                      draw_order=1))
        else:
            log(_IMAGE + "/segments", rr.Clear(recursive=False))
        log(_IMAGE + "/keypoints", rr.Points2D(d.keypoints, colors=d.colours, radii=2))
        log(_IMAGE + "/stereo", rr.LineStrips2D(d.stereo, colors=(120, 190, 255, 90), radii=0.5))
        if d.boxes:
            log(_IMAGE + "/things", rr.Boxes2D(
                mins=[b.low for b in d.boxes], sizes=[b.high - b.low for b in d.boxes],
                labels=[b.text for b in d.boxes], colors=[b.colour for b in d.boxes]))
        else:
            log(_IMAGE + "/things", rr.Clear(recursive=False))
        for name, value in d.numbers.items():
            stage = name[3:] if name.startswith("ms_") else None
            log(f"ms/{stage}" if stage else f"counts/{name}", rr.Scalars(value))
        if d.pose is None:
            log("events", rr.TextLog(f"frame {d.index} {d.name} is lost"))
            return
        log(_CAMERA, self._transform(d.pose))
        self.path.append(d.pose[:3, 3])
        if d.keyframe:
            log(_CAMERA + "/points", rr.Points3D(d.points, colors=d.point_colours, radii=_DOT))
            log("world/path/tracked", rr.LineStrips3D([np.array(self.path)], colors=TRACKED))

    def end(self, d: EndDrawing, classes: List[str]) -> None:
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
            for instance in np.unique(d.objects.instances):
                at = d.objects.instances == instance
                label = int(d.objects.labels[at][0])
                name = classes[label] if label < len(classes) else "thing"
                log(f"world/final/objects/{name.replace(' ', '_')}_{instance}",
                    rr.LineStrips3D([d.objects.positions[at]], colors=LOOP))
        for loop in d.loops:
            self.recording.set_time("time", timestamp=loop.timestamp)
            self.recording.set_time("frame", sequence=loop.frame)
            text = f"loop {loop.kind}: frame {loop.frame} with {loop.other}, {loop.gap_m:.3f} m open"
            log("events", rr.TextLog(text))
            if loop.line is not None:
                log("world/loop", rr.LineStrips3D([loop.line], colors=LOOP, radii=0.05))

    def close(self) -> None:
        self.recording.flush()
        self.recording.disconnect()
