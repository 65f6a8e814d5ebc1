# SPDX-License-Identifier: BSD-3-Clause
"""Poses of tests, as matrices and as text."""
import numpy as np

from evaluate_covariance import pose


def exponential(d):
    """Increment [w; v] as a matrix, for small w."""
    angle = np.linalg.norm(d[:3])
    axis = d[:3] / angle
    q = np.concatenate([np.sin(angle / 2) * axis, [np.cos(angle / 2)]])
    return pose(d[3:], q)


def quaternion(R):
    w = np.sqrt(1 + np.trace(R)) / 2
    return np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 4 * w * w]) / (4 * w)


def numbers(T):
    return [f"{v:.12g}" for v in [*T[:3, 3], *quaternion(T[:3, :3])]]
