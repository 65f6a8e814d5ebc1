# SPDX-License-Identifier: BSD-3-Clause
"""The SLAM system."""

from typing import Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from . import _core
from .features import Features
from .files import PathLike
from .kysp import DYNAMIC, NOT_JUDGED, SEGMENT
from .priors import PriorFrame, decode_prior, encode_prior


class Trajectory(NamedTuple):
    """One entry per frame fed."""

    timestamps: np.ndarray  #: (N,) float64, s
    poses: np.ndarray  #: (N, 4, 4) float64, left camera to world, m
    connected: np.ndarray  #: (N,) bool: in the frame of the sub-map with most frames; False: lost
    submaps: np.ndarray  #: (N,) int64: number of the frame's sub-map, -1: lost
    #: (N, 6, 6) float64, FrameReport.covariance as it was when the frame was tracked; nan: none
    covariances: np.ndarray
    motion_covariances: np.ndarray  #: (N, 6, 6) float64, FrameReport.motion_covariance; nan: none


class Observation(NamedTuple):
    """What the system saw in one frame; arrays have one entry per keypoint of the left image."""

    report: _core.FrameReport
    keypoints: np.ndarray  #: (N, 2) float32, px
    octaves: np.ndarray  #: (N,) uint8, pyramid level
    depths: np.ndarray  #: (N,) float32, m; negative: no stereo match
    landmarks: np.ndarray  #: (N,) int64, id of the landmark seen; -1: none
    labels: Optional[np.ndarray]  #: (N,) uint16, 65535 none; None: no priors for this frame
    instances: Optional[np.ndarray]  #: (N,) int32
    motions: Optional[np.ndarray]  #: (N,) float32, 0..100
    #: (N,) uint8: how a keypoint compares with its landmark, an index of TIERS; 6: no landmark
    tiers: np.ndarray
    #: instances of the priors (mode `verified`): (instance, label, p_moving 0..1, stereo keypoints)
    instances_seen: List[Tuple[int, int, float, int]]


TIERS = ("same instance", "cross instance", "cross class", "bypassed", "gated", "filtered", "none")


class Objects(NamedTuple):
    """Moving objects, one entry per frame and object; in the frame of the trajectory."""

    frames: np.ndarray  #: (N,) int64
    instances: np.ndarray  #: (N,) int32, identity over time
    labels: np.ndarray  #: (N,) uint16
    p_moving: np.ndarray  #: (N,) float64, 0..1
    positions: np.ndarray  #: (N, 3) float64, m
    velocities: np.ndarray  #: (N, 3) float64, m/s


class MapSnapshot(NamedTuple):
    """The map at one moment. Positions are in the frame of the sub-map they belong to."""

    frames: int  #: fed so far
    main_submap: int  #: the one the trajectory is expressed in
    keyframe_ids: np.ndarray  #: (K,) uint32
    keyframe_submaps: np.ndarray  #: (K,) uint32
    keyframe_times: np.ndarray  #: (K,) float64, s
    keyframe_poses: np.ndarray  #: (K, 4, 4) float64, left camera to world, m
    landmark_ids: np.ndarray  #: (L,) uint32
    landmark_submaps: np.ndarray  #: (L,) uint32
    landmark_labels: np.ndarray  #: (L,) uint16, index in the label space; 65535: none
    landmark_instances: np.ndarray  #: (L,) int32, -1: none
    landmark_beliefs: np.ndarray  #: (L,) float32, probability of standing still
    landmark_observations: np.ndarray  #: (L,) uint32, keyframes that see it
    landmark_points: np.ndarray  #: (L, 3) float64, m
    edges: np.ndarray  #: (E, 2) uint32, keyframe ids, the later one first
    edge_shared: np.ndarray  #: (E,) int32, landmarks both see
    edge_tree: np.ndarray  #: (E,) bool, edge of the spanning tree
    edge_loop: np.ndarray  #: (E,) bool, closed loop


class RigParameter(NamedTuple):
    """One way in which the cameras differ from the given calibration (kys_slam/rig_correction.h)."""

    value: float  #: 0: not corrected
    sigma: Optional[float]  #: standard deviation; None: not estimated
    unit: str  #: "px", "rad", or "": a ratio


class OffsetEstimate(NamedTuple):
    """An estimate of the offset of disparities alone."""

    value: float  #: px, to be added to every disparity
    sigma: float  #: px, with the systematic part
    applied: bool  #: it is what disparities are corrected by


class Rig(NamedTuple):
    """The calibration as the images show it."""

    corrected: str  #: "none", "offset" (of disparities alone) or "all"
    rows_sigma_before: Optional[float]  #: px, standard deviation of row differences; None: not measured
    rows_sigma_after: Optional[float]  #: px, the same with the correction that fits them
    rows_field: Optional[float]  #: px, root mean square of what that correction changes in rows
    parameters: Dict[str, RigParameter]  #: of the correction that is applied
    #: the latest estimate of the offset alone, applied or not; None: none, or all is corrected
    offset_estimate: Optional[OffsetEstimate] = None

    @property
    def offset(self) -> float:
        """px, added to every disparity."""
        return self.parameters["offset"].value

    @property
    def offset_sigma(self) -> Optional[float]:
        """px, its standard deviation; None: not estimated."""
        return self.parameters["offset"].sigma


class System(_core.System):
    """The SLAM system: feed rectified stereo frames in order, get poses.

    camera: the rectified pair.
    settings: Settings, or a dict of them; None: the defaults (driving).
    schedule: "pipelined" (mapping beside tracking), "sequential": both reproducible; "realtime".
    priors: folder of prior files, found by the name given with a frame; None: none but those in
        the frames of a feature file.
    strict_priors: a missing prior file raises InputError. Otherwise the first one is a warning of the
        logger "kys_slam".
    observer: called with an Observation after every frame, in the thread that feeds.
    features: in place of ORB a Features, or a function from an image (H, W) uint8 to its features as
        Features takes it; called for the left, then for the right image, in the thread that feeds.

    Poses, trajectory, map and snapshot may be requested from any thread at any time.
    """

    def __init__(self, camera: _core.StereoCamera,
                 settings: Union[_core.Settings, dict, None] = None, schedule: str = "pipelined",
                 priors: Optional[PathLike] = None, *, strict_priors: bool = False,
                 observer: Optional[Callable[[Observation], None]] = None,
                 features: Union[Features, Callable, None] = None) -> None:
        if settings is None or isinstance(settings, dict):
            settings = _core.Settings(settings or {})
        if features is not None and not isinstance(features, Features):
            features = Features(features)
        super().__init__(camera, settings, schedule, priors, strict_priors, features)
        self.camera, self.priors = camera, priors
        self._settings, self._space = settings, None
        if observer is not None:
            self.set_observer(observer)

    def feed(self, left: np.ndarray, right: np.ndarray, timestamp: float,
             segments: Union[PriorFrame, bytes, None] = None,
             masks: Union[Tuple[Optional[np.ndarray], Optional[np.ndarray]], None] = None, *,
             name: str = "", bgr: bool = False, index: Optional[int] = None
             ) -> _core.FrameReport:
        """Tracks the next frame.

        left, right: (H, W) uint8, (H, W) uint16 or (H, W, 3) uint8; any strides. Rectified, of
            the camera's size. Of uint16 the upper 8 of the bits count that the first pair uses (8 to 16);
            fewer than 16 are a warning of the logger "kys_slam".
        timestamp: s, strictly increasing.
        segments: the priors of this frame (or the bytes of a prior file), in place of the folder's.
        masks: (left, right), (H, W) uint8 each or None: 0 use, anything else not.
        name: of the frame, by which its prior file is found.
        bgr: colour images are in OpenCV's order.
        index: number of the frame in its recording, for reports and results; None: position among the
            frames fed, from 0.
        """
        return self._feed(left, right, timestamp, name, _as_bytes(segments), _as_pair(masks), bgr,
                          index)

    def feed_frame(self, frame: _core.StereoFrame,
                   segments: Union[PriorFrame, bytes, None] = None,
                   masks: Union[Tuple[Optional[np.ndarray], Optional[np.ndarray]], None] = None
                   ) -> _core.FrameReport:
        """The same with a frame of a Sequence, which has a number of its own: its position in the whole
        sequence."""
        return self._feed_frame(frame, _as_bytes(segments), _as_pair(masks))

    def add_segments(self, frame: int, segments: Union[PriorFrame, bytes, None]) -> None:
        """The segmentation of the left image of a frame, which may come late and for some frames only.
        From any thread.

        frame: index of the frame as fed: 0, 1, ...
        segments: as for feed(); a right camera in it is not used. None: this frame has none.

        It takes effect when frame `frame` + control.segment_lag is fed, or the next one where that is
        past; with the schedule "realtime" with the next one fed. From then on frames get its priors,
        moved with the scene and its instances, until the next segmentation. Numbers of instances need not
        persist over time. With control.segment_every = n frames 0, n, 2n, ... have one, and feed() waits
        for it where it takes effect (not "realtime"); so it has to come before, or from another thread.
        After control.segment_timeout the run goes on without any.
        """
        if segments is None:
            self._add_segments(frame, None, [])
            return
        if isinstance(segments, bytes):
            segments = decode_prior(segments, "segments")
        expected = self._label_space()
        if segments.label_space != expected:
            raise _core.InputError(f"segments of frame {frame}: their label space is "
                                   f"{segments.label_space}, configured is {expected}")
        camera = segments.cameras[0]
        rows = np.asarray(camera.segments, SEGMENT)
        moves = (rows["flags"] & DYNAMIC) != 0
        unjudged = ((rows["flags"] & NOT_JUDGED) != 0) | (~moves & (not segments.has_motion))
        self._add_segments(frame, np.ascontiguousarray(camera.segment_map, np.uint16),
                           list(zip(rows["label"].tolist(), rows["instance"].tolist(), moves.tolist(),
                                    unjudged.tolist())))

    def _label_space(self) -> str:
        if self._space is None:
            self._space = _core.LabelSpace(self._settings.get("control.label_space")).name
        return self._space

    def set_observer(self, observer: Optional[Callable[[Observation], None]]) -> None:
        """Calls `observer` after every frame that is fed from now on; None: no observer."""
        if observer is None:
            self._set_observer(None)
        else:
            self._set_observer(lambda seen: observer(Observation(**seen)))

    def trajectory(self) -> Trajectory:
        """Poses of all frames fed, as the map is now; final after finish()."""
        times, poses, connected, submaps, covariances, motions = self._trajectory()
        return Trajectory(times, poses, connected.astype(bool), submaps, covariances, motions)

    def keyframes(self) -> Tuple[np.ndarray, np.ndarray]:
        """Times (K,) s and poses (K, 4, 4) of the keyframes of the trajectory's sub-map."""
        return self._keyframes()

    def objects(self) -> Objects:
        """What moves, as mode `verified` judged it; nothing in other modes."""
        return Objects(*self._objects())

    def rig(self) -> Rig:
        """What the images said about the calibration, and the correction that is applied."""
        d = self._rig()
        d["parameters"] = {name: RigParameter(*p) for name, p in d["parameters"].items()}
        if d["offset_estimate"]:
            d["offset_estimate"] = OffsetEstimate(*d["offset_estimate"])
        return Rig(**d)

    def snapshot(self) -> MapSnapshot:
        """The whole map as it is now."""
        d = self._snapshot()
        for key in ("edge_tree", "edge_loop"):
            d[key] = d[key].astype(bool)
        return MapSnapshot(**d)

    def write_run(self, folder: PathLike, sequence: str = "sequence",
                  ground_truth: Optional[Tuple[np.ndarray, np.ndarray]] = None, *,
                  start_up_s: float = 0, wall_s: float = 0, cpu_s: float = 0,
                  end_reason: str = "", left_out: Optional[Dict[str, int]] = None,
                  warnings: Sequence[str] = (), recording: str = "") -> dict:
        """After finish(): the folder a command line run leaves (trajectory.tum, summary.json, ...).

        ground_truth: times (N,) s and poses (N, 4, 4) of the left camera.
        end_reason: why the run is not complete; "": it is.
        left_out: what the input holds and was not used, counts by what it is.
        warnings: what the user was shown, e.g. PairHistory.warning.
        recording: Sequence.recording, by which the C++ programs do not overwrite results of another
            recording of the same name.
        Returns a dict: frames, tracked, connected, loops, table (text), failure ("tracking failed: ..."
            when less than half of the frames are connected, else "").
        """
        return self._write_run(folder, sequence, ground_truth, start_up_s, wall_s, cpu_s,
                               end_reason, left_out or {}, list(warnings), recording)


def _as_bytes(segments: Union[PriorFrame, bytes, None]) -> Optional[bytes]:
    if segments is None or isinstance(segments, bytes):
        return segments
    return encode_prior(segments)


def _as_pair(masks) -> Tuple[Optional[np.ndarray], Optional[np.ndarray]]:
    if masks is None:
        return (None, None)
    left, right = masks
    return (left, right)
