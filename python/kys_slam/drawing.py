# SPDX-License-Identifier: BSD-3-Clause
"""What viewers show of a frame and of the end of a run, worked out of what the system reported."""

import struct
import zlib
from dataclasses import dataclass, field
from typing import Dict, Iterator, List, NamedTuple, Optional, Tuple

import numpy as np

from ._core import StereoCamera, _left_segments
from .kysp import DYNAMIC, NOT_JUDGED, SEGMENT, THING, VOID_LABEL
from .system import MapSnapshot, Objects, Trajectory

#: RGB of keypoints by their tier (kys_slam.TIERS): how they compare with their landmark
TIER_COLOURS = np.array([[70, 220, 90], [240, 220, 60], [245, 140, 40], [120, 190, 255],
                         [230, 50, 50], [230, 50, 50], [130, 130, 130]], np.uint8)
TRACKED, FINAL, GRAPH, LOOP = (240, 160, 40), (60, 140, 240), (110, 110, 110), (230, 50, 50)


def class_colours(labels: np.ndarray) -> np.ndarray:
    """(N, 3) uint8 of (N,) labels: those of map.ply; grey where there is none."""
    h = labels.astype(np.uint32) + np.uint32(1)
    for _ in range(2):
        h = (h ^ (h >> np.uint32(16))) * np.uint32(0x45D9F3B)
    h ^= h >> np.uint32(16)
    channels = [64 + ((h >> np.uint32(s)) & 0x7F) + ((h >> np.uint32(s + 7)) & 0x3F)
                for s in (0, 8, 16)]
    colours = np.stack(channels, axis=-1).astype(np.uint8)
    colours[labels == VOID_LABEL] = 150
    return colours


def class_name(label: int, classes: List[str]) -> str:
    """The name of a label; "thing": it has none."""
    return classes[label] if label < len(classes) else "thing"


def object_paths(objects: Objects, classes: List[str]) -> Iterator[Tuple[str, np.ndarray]]:
    """Of each moving object: a name without blanks, with its instance, and its positions, (N, 3) m."""
    for instance in np.unique(objects.instances):
        at = objects.instances == instance
        name = class_name(int(objects.labels[at][0]), classes)
        yield f"{name.replace(' ', '_')}_{instance}", objects.positions[at]


def _sigmas(kind: str, relative: Optional[dict]) -> Dict[str, float]:
    """Standard deviations of a relative pose: root of the trace, m and degrees."""
    d = np.full(6, np.nan) if relative is None else np.diag(np.reshape(relative["covariance"], (6, 6)))
    return {f"sigma_{kind}_m": float(np.sqrt(d[3:].sum())),
            f"sigma_{kind}_deg": float(np.degrees(np.sqrt(d[:3].sum())))}


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
    """An instance of the priors in the image."""

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
    segments: Optional[bytes]  #: PNG, prior segments: things by the belief in their moving
    keypoints: np.ndarray  #: (N, 2) float32, px
    tiers: np.ndarray  #: (N,) uint8, index of TIER_COLOURS
    stereo: np.ndarray  #: (M, 2, 2) float32, px, from a keypoint to its pixel in the right image
    points: Optional[np.ndarray]  #: (M, 3) m, stereo points in the camera's frame; of keyframes
    point_colours: Optional[np.ndarray]  #: (M, 3), by class
    boxes: List[Box]
    numbers: Dict[str, float]  #: counts, ms, standard deviations (nan: none), for plots
    #: "local", "motion", as far as known: other, pose (12,), covariance (36,), rows of RelativePose
    relative: Dict[str, dict]


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


class Seen(NamedTuple):
    """What the system reported of a frame (python/src/observation_pipe.h)."""

    #: index, name, timestamp, status, lost, pose (3, 4), local, motion, keyframe, counts, ms
    report: dict
    keypoints: np.ndarray  #: (N, 2) float32, px
    depths: np.ndarray  #: (N,) float32, m; negative: no stereo match
    tiers: np.ndarray  #: (N,) uint8, index of kys_slam.TIERS
    labels: Optional[np.ndarray]  #: (N,) uint16; None: no priors for this frame
    instances: Optional[np.ndarray]  #: (N,) int32
    motions: Optional[np.ndarray]  #: (N,) float32, 0..100
    p_moving: Dict[int, float]  #: of instances, 0..1; in mode `verified`
    jpeg: Optional[bytes]  #: of the left image


class Segments(NamedTuple):
    """The priors of the left image, as far as they are drawn."""

    segments: np.ndarray  #: (K,) of dtype kysp.SEGMENT
    segment_map: np.ndarray  #: (H, W) uint16: 0 void, k the segment segments[k - 1]
    boxes: np.ndarray  #: (K, 4) int, px: x0, y0, x1, y1, ends exclusive; all 0: no pixel

    @classmethod
    def decode(cls, data: bytes) -> "Segments":
        """Of the bytes of a prior file. Raises InputError for whatever is wrong with it."""
        d = _left_segments(data, "priors")
        return cls(np.array(d["segments"], SEGMENT), d["segment_map"], d["boxes"])


class LoopSeen(NamedTuple):
    """A loop that was closed, as reported."""

    frame: int
    other: int
    row: int  #: of the frame in the trajectory
    other_row: int  #: -1: none
    timestamp: float  #: s
    kind: str
    gap_m: float


class End(NamedTuple):
    """What came of a run."""

    trajectory: Trajectory
    snapshot: MapSnapshot
    objects: Objects
    loops: List[LoopSeen]


class Artist:
    """Draws frames and the end of one run."""

    def __init__(self, camera: StereoCamera, classes: List[str]) -> None:
        self._camera, self._classes = camera, classes
        self._tracked: List[np.ndarray] = []

    def draw(self, seen: Seen, prior: Optional[Segments]) -> FrameDrawing:
        """prior: None: there is none."""
        r, c = seen.report, self._camera
        pose = None
        if not r["lost"]:
            pose = np.vstack([np.reshape(r["pose"], (3, 4)), (0, 0, 0, 1)])
            self._tracked.append(pose[:3, 3])
        deep = np.flatnonzero(seen.depths > 0)
        uv, z = seen.keypoints[deep], seen.depths[deep]
        stereo = np.empty((len(deep), 2, 2), np.float32)
        stereo[:] = uv[:, None]
        stereo[:, 1, 0] -= c.fx * c.baseline / z
        points = colours = None
        if r["keyframe"]:
            points = np.column_stack([(uv - (c.cx, c.cy)) / (c.fx, c.fy) * z[:, None], z])
            colours = class_colours(np.full(len(deep), VOID_LABEL, np.uint16) if seen.labels is None
                                    else seen.labels[deep])
        numbers = {**r["counts"], **{f"ms_{stage}": ms for stage, ms in r["ms"].items()},
                   **_sigmas("local", r["local"]), **_sigmas("motion", r["motion"])}
        if prior is None:
            segments, boxes = None, self._boxes_of_keypoints(seen)
        else:
            moving = self._segments_moving(seen, prior)
            segments = segment_picture(prior, moving)
            boxes = self._boxes_of_segments(prior, moving)
        return FrameDrawing(r["index"], r["name"], r["timestamp"], r["status"], pose, seen.jpeg,
                            segments, seen.keypoints, seen.tiers, stereo, points, colours, boxes,
                            numbers, {key: r[key] for key in ("local", "motion") if r[key]})

    def _segments_moving(self, seen: Seen, prior: Segments) -> np.ndarray:
        """(K,) belief in the moving of each segment, 0..1; nan: not a thing, or not judged."""
        table = prior.segments
        moving = np.where(table["flags"] & DYNAMIC, np.maximum(table["score"] / 100, 0.5), 0.0)
        moving[(table["flags"] & NOT_JUDGED) != 0] = np.nan
        if seen.p_moving and seen.instances is not None:
            height, width = prior.segment_map.shape
            u = np.clip(np.rint(seen.keypoints[:, 0]).astype(int), 0, width - 1)
            v = np.clip(np.rint(seen.keypoints[:, 1]).astype(int), 0, height - 1)
            under = prior.segment_map[v, u]
            # The system numbers instances anew where a map was loaded: found by their keypoints.
            for instance, p in seen.p_moving.items():
                on_it = under[(seen.instances == instance) & (under > 0)]
                if len(on_it):
                    moving[np.bincount(on_it).argmax() - 1] = p
        moving[(table["flags"] & THING) == 0] = np.nan
        return moving

    def _boxes_of_segments(self, prior: Segments, moving: np.ndarray) -> List[Box]:
        boxes = []
        for segment, box, p in zip(prior.segments, prior.boxes, moving):
            if not segment["flags"] & THING or segment["area"] < 100:
                continue
            what = f"{class_name(segment['label'], self._classes)} {segment['instance']}"
            boxes.append(Box(
                box[:2], box[2:],
                f"{what}, not judged" if np.isnan(p) else f"{what}, moving {p:.2f}",
                belief_colour(p)))
        return boxes

    def _boxes_of_keypoints(self, seen: Seen) -> List[Box]:
        """For priors without pictures (feature files)."""
        if seen.instances is None:
            return []
        boxes = []
        for instance in np.unique(seen.instances[seen.instances >= 0]):
            on_it = seen.instances == instance
            motion = float(seen.motions[on_it].max())
            if np.count_nonzero(on_it) < 5 or (int(instance) not in seen.p_moving and motion == 0):
                continue  # stuff, and things nothing is known of
            p = seen.p_moving.get(int(instance), motion / 100)
            xy = seen.keypoints[on_it]
            name = class_name(seen.labels[on_it][0], self._classes)
            boxes.append(Box(xy.min(0), xy.max(0), f"{name} {instance}, moving {p:.2f}",
                             belief_colour(p)))
        return boxes

    def draw_end(self, end: End) -> EndDrawing:
        t, s = end.trajectory, end.snapshot
        own = s.landmark_submaps == s.main_submap
        place = {int(i): pose[:3, 3] for i, pose, submap in
                 zip(s.keyframe_ids, s.keyframe_poses, s.keyframe_submaps)
                 if submap == s.main_submap}

        def lines(which: np.ndarray) -> np.ndarray:
            ends = [[place[a], place[b]] for a, b in s.edges[which].tolist()
                    if a in place and b in place]
            return np.array(ends).reshape(-1, 2, 3)

        loops = []
        for loop in end.loops:
            rows = [loop.row, loop.other_row]
            both = loop.other_row >= 0 and t.connected[rows].all()
            loops.append(Loop(loop.frame, loop.other, loop.timestamp, loop.kind, loop.gap_m,
                              t.poses[rows, :3, 3] if both else None))
        return EndDrawing(t.timestamps[t.connected], t.poses[t.connected],
                          np.array(self._tracked).reshape(-1, 3), s, s.landmark_points[own], own,
                          class_colours(s.landmark_labels[own]), lines(~s.edge_loop),
                          lines(s.edge_loop), loops, end.objects)


def belief_colour(p_moving: float) -> Tuple[int, int, int]:
    """Green: stands still; red: moves; grey-blue for nan: not judged."""
    if np.isnan(p_moving):
        return (130, 150, 190)
    still, moves = np.array([70, 220, 90]), np.array([230, 50, 50])
    return tuple(int(v) for v in np.rint(still + p_moving * (moves - still)))


def segment_picture(prior: Segments, moving: np.ndarray) -> bytes:
    """PNG of the segments: things by belief_colour, the rest by class, void transparent.

    moving: (K,) 0..1, nan: not judged.
    """
    colours = class_colours(prior.segments["label"])
    opacity = np.full(len(colours), 70, np.uint8)
    for k in np.flatnonzero(prior.segments["flags"] & THING):
        colours[k], opacity[k] = belief_colour(moving[k]), 150
    rgba = np.zeros((len(colours) + 1, 4), np.uint8)
    rgba[1:, :3], rgba[1:, 3] = colours, opacity
    if len(rgba) <= 256:
        return encode_png(prior.segment_map.astype(np.uint8), rgba)
    palette, index = np.unique(rgba, axis=0, return_inverse=True)
    index = np.minimum(index.ravel(), 255).astype(np.uint8)  # more are not distinguished
    return encode_png(index[prior.segment_map], palette[:256])


def encode_png(pixels: np.ndarray, palette: np.ndarray) -> bytes:
    """PNG of (H, W) uint8 indices of an (N, 4) uint8 RGBA palette."""
    height, width = pixels.shape
    bits = 4 if len(palette) <= 16 else 8
    if bits == 4:  # two pixels in a byte: half of the time
        even = np.pad(pixels, ((0, 0), (0, width % 2)))
        pixels = even[:, ::2] << 4 | even[:, 1::2]

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (struct.pack(">I", len(data)) + kind + data +
                struct.pack(">I", zlib.crc32(kind + data)))

    rows = np.zeros((height, pixels.shape[1] + 1), np.uint8)  # each begins with filter 0
    rows[:, 1:] = pixels
    return (b"\x89PNG\r\n\x1a\n" +
            chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 3, 0, 0, 0)) +
            chunk(b"PLTE", palette[:, :3].tobytes()) + chunk(b"tRNS", palette[:, 3].tobytes()) +
            chunk(b"IDAT", zlib.compress(rows.tobytes(), 1)) + chunk(b"IEND", b""))


class Sink:
    """Where drawings go. Called by one thread."""

    def start(self, camera: StereoCamera) -> None: ...
    def frame(self, drawing: FrameDrawing) -> None: ...
    def end(self, drawing: EndDrawing, classes: List[str]) -> None: ...
    def close(self) -> None: ...
