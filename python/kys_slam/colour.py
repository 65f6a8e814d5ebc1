# SPDX-License-Identifier: BSD-3-Clause
"""The left image of a frame in colour, for networks: tracking takes grey images."""

from typing import Any, Optional

import numpy as np


def rectified(rectifier: Any, image: np.ndarray) -> np.ndarray:
    """An (H, W, 3) uint8 image by the left maps of a StereoRectifier; None: as it is."""
    if rectifier is None:
        return np.ascontiguousarray(image)
    return np.stack([rectifier.rectify_left(np.ascontiguousarray(image[:, :, c])) for c in range(3)],
                    axis=-1)


def _of_file(recording: Any, frame: Any) -> Optional[np.ndarray]:
    """Of a sequence whose left image of this frame is a colour file."""
    import cv2

    file = recording.left_file(frame.index)
    image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED) if file else None
    if image is None or image.ndim != 3 or image.shape[2] < 3 or image.dtype != np.uint8 \
            or image.shape[:2] != frame.left.shape:
        return None
    return rectified(recording.rectifier, image[:, :, 2::-1])


def left_colour(recording: Any, frame: Any) -> np.ndarray:
    """(H, W, 3) uint8 RGB, rectified, of a frame of the recording. Where it has no colour, the grey
    image, repeated. A Recording keeps colour from `keep_colour` = True on."""
    image = getattr(frame, "colour", None)
    if image is None and hasattr(recording, "left_file"):
        image = _of_file(recording, frame)
    return image if image is not None else np.repeat(np.asarray(frame.left)[:, :, None], 3, axis=2)
