# SPDX-License-Identifier: BSD-3-Clause
"""What the programs around ONNX networks share: the network with its YAML file, images, threads. The
network itself is python/kys_slam/segment_network.py."""

import concurrent.futures
import os
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import common  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "python" / "kys_slam"))
import segment_network  # noqa: E402


class OnnxNetwork(segment_network.OnnxNetwork):
    """The same, with errors as the tools report them."""

    _errors = (common.InputError,)
    fail = staticmethod(common.fail)


def read_image(path):
    """(H, W, 3) uint8, RGB; grey images are repeated."""
    import cv2

    try:
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    except cv2.error:  # too large
        image = None
    if image is None:
        common.fail(f"{path}: cannot read")
    return np.ascontiguousarray(image[:, :, ::-1])


def in_threads(function, items, label, jobs):
    """[function(item)] for all items, `jobs` at a time, with progress. An error ends all threads."""
    pool = concurrent.futures.ThreadPoolExecutor(jobs)
    try:
        work = [pool.submit(function, item) for item in items]
        return [item.result() for item in common.progress(work, label)]
    finally:
        pool.shutdown(cancel_futures=True)


def add_jobs(parser):
    parser.add_argument("--jobs", type=common.whole(1), default=os.cpu_count() or 1,
                        help="threads (default: all)")
