"""What the system sees, shown while it runs or recorded for later.

    recorder = open_recorder("run.rrd", slam.camera)       # or run.mcap, or VIEWER
    slam.set_observer(lambda seen: recorder.add(seen, left_image))
    ...                                                    # feed frames, finish()
    recorder.close(slam)

.rrd files and the live view are Rerun's (rerun-sdk), .mcap files hold Foxglove's schemas
(mcap-protobuf-support, foxglove-schemas-protobuf). Drawing happens in a thread of its own; the
thread that feeds hands over arrays. Recording changes no result.
"""

import os
import queue
import threading
from dataclasses import dataclass, field
from typing import Dict, List, Optional, Tuple, Union

import numpy as np

from ._core import InputError, LabelSpace, StereoCamera, encode_jpeg
from .system import MapSnapshot, Objects, Observation, System

VIEWER = "viewer"  #: the target of open_recorder that shows instead of writing

#: RGB of keypoints by their tier (kys_slam.TIERS): how they compare with their landmark
TIER_COLOURS = np.array([[70, 220, 90], [240, 220, 60], [245, 140, 40], [120, 190, 255],
                         [230, 50, 50], [230, 50, 50], [130, 130, 130]], np.uint8)
TRACKED, FINAL, GRAPH, LOOP = (240, 160, 40), (60, 140, 240), (110, 110, 110), (230, 50, 50)
_VOID = 0xFFFF
_QUEUE = 64  # frames that may wait to be drawn; then feeding waits


def class_colours(labels: np.ndarray) -> np.ndarray:
    """(N, 3) uint8 of (N,) labels: those of map.ply; grey where there is none."""
    h = labels.astype(np.uint32) + np.uint32(1)
    for _ in range(2):
        h = (h ^ (h >> np.uint32(16))) * np.uint32(0x45D9F3B)
    h ^= h >> np.uint32(16)
    channels = [64 + ((h >> np.uint32(s)) & 0x7F) + ((h >> np.uint32(s + 7)) & 0x3F)
                for s in (0, 8, 16)]
    colours = np.stack(channels, axis=-1).astype(np.uint8)
    colours[labels == _VOID] = 150
    return colours


def quaternion(r: np.ndarray) -> np.ndarray:
    """(x, y, z, w) of a rotation matrix, from its largest component (Shepperd, 1978)."""
    q = np.empty(4)
    largest = int(np.argmax([r[0, 0], r[1, 1], r[2, 2], np.trace(r)]))
    if largest == 3:
        q[:] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1 + np.trace(r)
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q[i], q[3] = 1 + r[i, i] - r[j, j] - r[k, k], r[k, j] - r[j, k]
        q[j], q[k] = r[i, j] + r[j, i], r[i, k] + r[k, i]
    q /= np.linalg.norm(q)
    return q if q[3] >= 0 else -q


@dataclass
class Box:
    """A thing of the priors in the image: around its keypoints."""

    low: np.ndarray  #: (2,) px
    high: np.ndarray  #: (2,) px
    text: str
    colour: Tuple[int, int, int]


@dataclass
class FrameDrawing:
    """What is drawn of one frame."""

    index: int
    name: str
    timestamp: float  #: s
    status: str
    pose: Optional[np.ndarray]  #: (4, 4) left camera to world; None: lost
    jpeg: Optional[bytes]
    keypoints: np.ndarray  #: (N, 2) px
    colours: np.ndarray  #: (N, 3)
    stereo: np.ndarray  #: (M, 2, 2) px, from a keypoint to its pixel in the right image
    points: np.ndarray  #: (M, 3) m, stereo points in the camera's frame
    point_colours: np.ndarray  #: (M, 3), by class
    boxes: List[Box]
    numbers: Dict[str, float]  #: counts and ms, for plots
    keyframe: bool


@dataclass
class Loop:
    """A loop that was closed, or a sub-map that was merged."""

    frame: int
    other: int
    timestamp: float  #: s
    kind: str
    gap_m: float
    line: Optional[np.ndarray]  #: (2, 3) m, between the two frames in the final trajectory


@dataclass
class EndDrawing:
    """What is drawn when all is optimised."""

    timestamps: np.ndarray  #: (N,) s, of connected frames
    poses: np.ndarray  #: (N, 4, 4)
    tracked: np.ndarray  #: (K, 3) m, the path as it was tracked
    snapshot: MapSnapshot
    points: np.ndarray  #: (L, 3) m, of the trajectory's sub-map
    own: np.ndarray  #: (all landmarks,) bool: which of the snapshot's
    colours: np.ndarray  #: (L, 3), by class
    graph: np.ndarray  #: (E, 2, 3) m
    loop_edges: np.ndarray  #: (F, 2, 3) m
    loops: List[Loop] = field(default_factory=list)
    objects: Optional[Objects] = None


class Sink:
    """Where drawings go. Called by one thread."""

    def start(self, camera: StereoCamera) -> None: ...
    def frame(self, drawing: FrameDrawing) -> None: ...
    def end(self, drawing: EndDrawing, classes: List[str]) -> None: ...
    def close(self) -> None: ...


class Recorder:
    """Draws frames into a sink, in a thread of its own."""

    def __init__(self, sink: Sink, camera: StereoCamera, classes: List[str], images: bool) -> None:
        self._sink, self._camera, self._classes, self._images = sink, camera, classes, images
        self._tracked: List[np.ndarray] = []
        self._queue: queue.Queue = queue.Queue(_QUEUE)
        self._error: Optional[BaseException] = None
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    def add(self, seen: Observation, left: Optional[np.ndarray] = None) -> None:
        """What an observer was told of a frame, and its left image, which must not change later."""
        if self._error:
            raise self._error
        if not seen.report.lost:
            self._tracked.append(seen.report.pose[:3, 3])
        self._queue.put((seen, left))

    def close(self, slam: Optional[System] = None) -> None:
        """Ends the recording; with the system, after its finish(), what came of it is drawn too.
        Raises InputError when the recording cannot be written."""
        self._queue.put((slam, None))
        self._queue.put(None)
        self._thread.join()
        if self._error:
            raise self._error

    def _work(self) -> None:
        try:
            self._sink.start(self._camera)
            while (item := self._queue.get()) is not None:
                what, left = item
                if isinstance(what, Observation):
                    self._sink.frame(self._draw(what, left))
                elif what is not None:
                    self._sink.end(self._draw_end(what), self._classes)
        except BaseException as error:  # raised where add() or close() is called
            self._error = (InputError(f"the recording cannot be written: {error}")
                           if isinstance(error, OSError) else error)
        try:
            self._sink.close()
        except Exception as error:
            self._error = self._error or error
        while self._error and self._queue.get() is not None:
            pass

    def _draw(self, seen: Observation, left: Optional[np.ndarray]) -> FrameDrawing:
        report, c = seen.report, self._camera
        deep = seen.depths > 0
        uv, z = seen.keypoints[deep], seen.depths[deep]
        disparity = c.fx * c.baseline / z
        right = uv - np.stack([disparity, np.zeros_like(disparity)], axis=-1)
        points = np.stack([(uv[:, 0] - c.cx) / c.fx * z, (uv[:, 1] - c.cy) / c.fy * z, z], axis=-1)
        labels = np.full(len(deep), _VOID, np.uint16) if seen.labels is None else seen.labels
        numbers = {"keypoints": report.keypoints, "stereo_matches": report.stereo_matches,
                   "matches": report.matches, "inliers": report.inliers, "masked": report.masked}
        numbers.update({f"ms_{stage}": ms for stage, ms in report.times_ms.items()})
        return FrameDrawing(
            report.index, report.name, report.timestamp, report.status,
            None if report.lost else report.pose,
            encode_jpeg(left, 80) if self._images and left is not None else None,
            seen.keypoints, TIER_COLOURS[seen.tiers],
            np.stack([uv, right], axis=1), points, class_colours(labels[deep]), self._boxes(seen),
            numbers, report.keyframe)

    def _boxes(self, seen: Observation) -> List[Box]:
        if seen.instances is None:
            return []
        moving = {i[0]: i[2] for i in seen.instances_seen}
        boxes = []
        for instance in np.unique(seen.instances[seen.instances >= 0]):
            on_it = seen.instances == instance
            label, motion = seen.labels[on_it][0], float(seen.motions[on_it].max())
            if np.count_nonzero(on_it) < 5 or (int(instance) not in moving and motion == 0):
                continue  # stuff, and things nothing is known of
            what = self._classes[label] if label < len(self._classes) else "?"
            p = moving.get(int(instance), motion / 100)
            xy = seen.keypoints[on_it]
            boxes.append(Box(xy.min(0), xy.max(0), f"{what} {instance}, moving {p:.2f}",
                             (230, 50, 50) if p > 0.5 else (70, 220, 90)))
        return boxes

    def _draw_end(self, slam: System) -> EndDrawing:
        t, s = slam.trajectory(), slam.snapshot()
        own = s.landmark_submaps == s.main_submap
        place = {int(i): pose[:3, 3] for i, pose, submap in
                 zip(s.keyframe_ids, s.keyframe_poses, s.keyframe_submaps)
                 if submap == s.main_submap}

        def lines(which: np.ndarray) -> np.ndarray:
            ends = [[place[a], place[b]] for a, b in s.edges[which].tolist()
                    if a in place and b in place]
            return np.array(ends).reshape(-1, 2, 3)

        loops = []
        for r in slam.reports():
            if r.loop not in ("closed", "merged"):
                continue
            both = 0 <= r.loop_frame < len(t.poses) and t.connected[[r.index, r.loop_frame]].all()
            loops.append(Loop(r.index, r.loop_frame, r.timestamp, r.loop, r.loop_gap_m,
                              t.poses[[r.index, r.loop_frame], :3, 3] if both else None))
        return EndDrawing(t.timestamps[t.connected], t.poses[t.connected],
                          np.array(self._tracked).reshape(-1, 3), s, s.landmark_points[own], own,
                          class_colours(s.landmark_labels[own]), lines(~s.edge_loop),
                          lines(s.edge_loop), loops, slam.objects())


def open_recorder(target: Union[str, os.PathLike], camera: StereoCamera,
                  label_space: str = "coco_panoptic_133", images: bool = True) -> Recorder:
    """A Recorder to FILE.rrd or FILE.mcap, or to Rerun's viewer (VIEWER).

    label_space: of the priors, for names of classes.
    images: JPEGs of the left camera go along (about 5 ms of one core per frame).
    """
    target = os.fspath(target)
    if target == VIEWER or target.endswith(".rrd"):
        from .record_rerun import RerunSink
        sink: Sink = RerunSink(None if target == VIEWER else target)
    elif target.endswith(".mcap"):
        from .record_mcap import McapSink
        sink = McapSink(target)
    else:
        raise InputError(f"{target}: recordings are FILE.rrd or FILE.mcap")
    return Recorder(sink, camera, LabelSpace(label_space).names, images)
