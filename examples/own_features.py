# SPDX-License-Identifier: BSD-3-Clause
"""Features of your own in place of ORB: SIFT of OpenCV, 128 floats, as a function of an image.

    python examples/own_features.py SEQUENCE          (KITTI, Virtual KITTI 2, EuRoC)
"""

import sys

import cv2
import numpy as np

import kys_slam

SIFT = cv2.SIFT_create(nfeatures=2000)


def sift(image):
    """(H, W) uint8 to one entry per keypoint."""
    found, descriptors = SIFT.detectAndCompute(image, None)
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 128))
    return {"positions": np.array([k.pt for k in found]),
            "descriptors": np.sqrt(descriptors),  # as Arandjelovic and Zisserman, 2012
            "scores": np.array([k.response for k in found]),
            "scales": np.array([max(1, k.size / 4) for k in found]),
            "angles": np.radians([k.angle for k in found])}


def main(sequence):
    recording = kys_slam.open_sequence(sequence)
    features = kys_slam.Features(sift, "rootsift", levels=16, scale_factor=1.26, oriented=True)
    slam = kys_slam.System(recording.camera, features=features)
    for frame in recording:
        report = slam.feed_frame(frame)
        print(frame.name, report.status, report.matches, "landmarks")
    slam.finish()


if __name__ == "__main__":
    main(sys.argv[1])
