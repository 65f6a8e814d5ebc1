# SPDX-License-Identifier: BSD-3-Clause
"""Prior files (.kysp): what perception says about the pixels of a stereo frame.

Three lines make priors of a class map:

    space = kys_slam.LabelSpace("coco_panoptic_133")
    frame = kys_slam.priors_from_labels(space, left_classes, right_classes)   # (H, W) of class ids
    kys_slam.write_prior("000123.kysp", frame)
"""

import os
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import List, Optional, Tuple

import numpy as np

from . import _core
from .files import PathLike, read_bytes
from .kysp import (DYNAMIC, MAX_SEGMENTS, RIGHT_INSTANCES, SEGMENT, THING,
                   dynamic_by_number)


@dataclass
class PriorCamera:
    """Priors of one camera.

    segments: (K,) of dtype kysp.SEGMENT: label (index in the label space), flags (kysp.THING,
        DYNAMIC, NOT_JUDGED, RADIAL_ONLY), instance, scale (px^2 m^2), score (0..100), area (px,
        filled in when written).
    segment_map: (H, W) uint16: 0 void, k the segment segments[k - 1].
    motion: (H, W) float32, 0..100, read inside dynamic segments; None: none.
    """

    segments: np.ndarray
    segment_map: np.ndarray
    motion: Optional[np.ndarray] = None


@dataclass
class PriorFrame:
    """Priors of one stereo frame: one camera (left) or two (left, right)."""

    label_space: str
    cameras: List[PriorCamera] = field(default_factory=list)
    calibration_hash: int = 0  # StereoCamera.calibration_hash(); 0 fits any camera
    content_key: int = 0
    has_motion: bool = False  # motion was judged: what is not flagged as moving stands still
    #: one object has one instance; in the right camera it is that plus RIGHT_INSTANCES
    shares_instances: bool = False


def encode_prior(frame: PriorFrame) -> bytes:
    """The bytes of a prior file. Raises InputError for values that are out of range."""
    cameras = []
    for camera in frame.cameras:
        motion = camera.motion
        cameras.append({
            "segments": [tuple(row) for row in np.asarray(camera.segments, SEGMENT).tolist()],
            "segment_map": np.ascontiguousarray(camera.segment_map, np.uint16),
            "motion": None if motion is None else np.ascontiguousarray(motion, np.float32),
        })
    return _core._encode_priors(frame.label_space, cameras, frame.calibration_hash,
                                frame.content_key, frame.has_motion, frame.shares_instances)


def decode_prior(data: bytes, name: str = "prior file") -> PriorFrame:
    """A PriorFrame from the bytes of a file. Raises InputError for whatever is wrong with it."""
    d = _core._decode_priors(bytes(data), name)
    cameras = [PriorCamera(np.array(c["segments"], SEGMENT), c["segment_map"], c["motion"])
               for c in d["cameras"]]
    return PriorFrame(d["label_space"], cameras, d["calibration_hash"], d["content_key"],
                      d["has_motion"], d["shares_instances"])


def read_prior(path: PathLike) -> PriorFrame:
    """Reads a prior file."""
    return decode_prior(read_bytes(path), str(path))


def write_prior(path: PathLike, frame: PriorFrame) -> None:
    """Writes a prior file; it takes its name when it is complete."""
    data = encode_prior(frame)
    path = Path(path)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def _whole_numbers(instances: np.ndarray) -> np.ndarray:
    """An instance map as int64. InputError for values that are none."""
    given = np.asarray(instances)
    with np.errstate(invalid="ignore"):  # NaN, infinity
        ids = given.astype(np.int64)
    if not np.array_equal(ids, given):
        raise _core.InputError("an instance map is a (H, W) array of whole numbers")
    return ids


def _one_camera(space: "_core.LabelSpace", classes: np.ndarray, instances: Optional[np.ndarray],
                dynamic: Tuple[int, ...], first_instance: int) -> PriorCamera:
    classes = np.asarray(classes)
    if classes.ndim != 2 or not np.issubdtype(classes.dtype, np.integer):
        raise _core.InputError("a class map is a (H, W) array of whole numbers")
    ids = _whole_numbers(np.zeros_like(classes) if instances is None else instances)
    if ids.shape != classes.shape:
        raise _core.InputError("class map and instance map differ in size")
    index_of = {class_id: index for index, class_id in enumerate(space.ids)}
    things = space.things
    pairs, inverse = np.unique(np.stack([classes.ravel(), ids.ravel()]), axis=1,
                               return_inverse=True)
    largest = RIGHT_INSTANCES - len(index_of) - 1
    number = np.zeros(pairs.shape[1], np.int64)
    rows = []
    for k, (class_id, instance) in enumerate(pairs.T):
        index = index_of.get(int(class_id))
        if index is None:
            continue  # void: no class of this label space
        if things[index] and not 0 <= instance <= largest:
            raise _core.InputError(f"instance {instance} is not in 0..{largest}")
        moving = int(instance) in dynamic and instance != 0
        # Stuff is one instance per class; things are numbered by the caller.
        identity = len(index_of) + int(instance) if things[index] and instance else index
        rows.append((index, (THING if things[index] else 0) | (DYNAMIC if moving else 0),
                     first_instance + identity, 0.0, 0.0, 0))
        number[k] = len(rows)
    if len(rows) > MAX_SEGMENTS:
        raise _core.InputError(f"more than {MAX_SEGMENTS} segments in one image")
    segments = np.array(rows, SEGMENT)
    segment_map = number.astype(np.uint16)[inverse.ravel()].reshape(classes.shape)
    is_moving = dynamic_by_number(segments)
    motion = np.where(is_moving[segment_map], np.float32(100), np.float32(0))
    return PriorCamera(segments, segment_map, motion if is_moving.any() else None)


def priors_from_labels(space: "_core.LabelSpace", left: np.ndarray,
                       right: Optional[np.ndarray] = None,
                       left_instances: Optional[np.ndarray] = None,
                       right_instances: Optional[np.ndarray] = None,
                       moving: Optional[Tuple[int, ...]] = None) -> PriorFrame:
    """Priors from class maps of both images.

    left, right: (H, W) of class ids as the data set numbers them (COCO, ADE20K, Cityscapes, ...);
        an id that is none of the label space's is void. right None: of the left image only, as
        System.add_segments takes them.
    left_instances, right_instances: (H, W), 0 none, else a number that an object keeps over time,
        below 2^30 less the number of classes.
    moving: numbers of the instances that move: flagged (mode `mask` drops them), motion 100; all
        others stand still. None: whether anything moves is not known.
    """
    dynamic = moving or ()
    cameras = [_one_camera(space, left, left_instances, dynamic, 0)]
    if right is not None:
        cameras.append(_one_camera(space, right, right_instances, dynamic, RIGHT_INSTANCES))
    return PriorFrame(space.name, cameras, has_motion=moving is not None)
