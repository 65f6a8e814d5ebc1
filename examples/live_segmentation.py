# SPDX-License-Identifier: BSD-3-Clause
"""A network beside the tracker: live_segmentation.py SEQUENCE

Put your own network in the place of `segment`: image -> class ids, instances."""

import sys

import numpy as np

import kys_slam
from kys_slam.segmenter import Segmenter

SPACE = kys_slam.LabelSpace("coco_panoptic_133")
CLASS = dict(zip(SPACE.names, SPACE.ids))


def segment(image: np.ndarray):
    """(H, W) class ids and (H, W) instances, 0 none, of a (H, W) image. Numbers of instances need not
    persist from image to image. Here: sky above, road below, no things."""
    labels = np.full(image.shape, CLASS["road"])
    labels[:image.shape[0] // 2] = CLASS["sky-other-merged"]
    return labels, np.zeros(image.shape, int)


def segments_of(frame) -> kys_slam.PriorFrame:
    """Runs in a thread of its own, for every fifth frame."""
    labels, instances = segment(frame.left)
    return kys_slam.priors_from_labels(SPACE, labels, left_instances=instances)


def main(path: str) -> None:
    sequence = kys_slam.open_sequence(path)
    slam = kys_slam.System(sequence.camera, {
        "kys.mode": "verified", "control.segment_every": 5,
        "control.segment_lag": 5})  # frames: a network this slow is not waited for
    with Segmenter(slam, segments_of, every=5) as segmenter:
        for frame in sequence:
            segmenter.offer(frame)
            report = slam.feed_frame(frame)
            segmenter.fed()
            if report.segments_of >= 0:
                print(f"frame {report.index}: segments of frame {report.segments_of}")
    slam.finish()
    print(f"{segmenter.segmented} frames segmented, {slam.trajectory().connected.sum()} tracked")


if __name__ == "__main__":
    main(sys.argv[1])
