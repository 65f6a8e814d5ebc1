# SPDX-License-Identifier: BSD-3-Clause
"""KYS-SLAM: stereo visual SLAM with semantic and motion priors in feature matching.

    import kys_slam

    camera = kys_slam.StereoCamera(width=1226, height=370, fx=707.1, fy=707.1, cx=601.9, cy=183.1,
                                   baseline=0.537)
    slam = kys_slam.System(camera)
    for left, right, time in my_camera():          # NumPy arrays, rectified; s
        report = slam.feed(left, right, time)
        if not report.lost:
            steer(report.pose)                     # (4, 4), left camera to world, m
    slam.finish()
    trajectory = slam.trajectory()                 # after all optimisation

Raw cameras are rectified by `StereoRectifier(read_stereo_rig(["camchain.yaml"]))`. Recorded frames
come from `open_sequence`, `open_image_pair` and kys_slam.recordings (videos, ROS bags).
Whatever is wrong with an input raises InputError (a ValueError), a call at the wrong time LogicError
(a RuntimeError). The functions that compute release the GIL.
"""

from ._core import (  # noqa: F401
    DistanceModel,
    FrameReport,
    InputError,
    LabelSpace,
    LogicError,
    PairCheck,
    PairHistory,
    Priors,
    RelativePose,
    RowField,
    RowMeter,
    Sequence,
    Settings,
    StereoCamera,
    StereoFrame,
    StereoRectifier,
    StereoRig,
    __version__,
    builtin_label_spaces,
    check_stereo_pair,
    check_writable,
    evaluate,
    has_rig_correction,
    mode_needs_priors,
    modes,
    open_image_pair,
    open_sequence,
    read_stereo_rig,
    read_tum,
    rig_from_camera_info,
    to_gray,
    used_bits,
    write_tum,
)
from .features import Features, binarise
from .maps import LandmarkMap, read_map
from .priors import PriorCamera, PriorFrame, priors_from_labels, read_prior, write_prior
from .system import TIERS, MapSnapshot, Objects, Observation, Rig, RigParameter, System, Trajectory

__all__ = [
    "DistanceModel", "Features", "FrameReport", "InputError", "LabelSpace", "LandmarkMap", "LogicError", "MapSnapshot",
    "Objects", "Observation", "PairCheck", "PairHistory", "PriorCamera", "PriorFrame", "Priors", "RelativePose",
    "Rig", "RigParameter", "RowField", "RowMeter", "Sequence", "Settings", "StereoCamera", "StereoFrame",
    "StereoRectifier", "StereoRig", "System", "TIERS", "Trajectory", "binarise", "builtin_label_spaces",
    "check_stereo_pair", "check_writable", "evaluate", "has_rig_correction", "mode_needs_priors", "modes", "open_image_pair",
    "open_sequence", "priors_from_labels", "read_map", "read_prior", "read_stereo_rig", "read_tum",
    "rig_from_camera_info", "to_gray", "used_bits", "write_prior", "write_tum",
]
