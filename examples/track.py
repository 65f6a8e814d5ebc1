# SPDX-License-Identifier: BSD-3-Clause
"""Tracks a recorded sequence in Python: track.py SEQUENCE OUT.ply"""

import sys

import numpy as np

import kys_slam


def on_frame(seen: kys_slam.Observation) -> None:
    if seen.report.keyframe:
        near = np.count_nonzero((seen.depths > 0) & (seen.depths < 10))
        print(f"keyframe at {seen.report.timestamp:.2f} s, {near} points nearer than 10 m")


def main(path: str, ply: str) -> None:
    sequence = kys_slam.open_sequence(path)
    slam = kys_slam.System(sequence.camera, observer=on_frame)
    for frame in sequence:
        slam.feed_frame(frame)
    slam.finish()

    trajectory = slam.trajectory()
    if sequence.ground_truth:
        connected = trajectory.connected
        figures = kys_slam.evaluate(*sequence.ground_truth, trajectory.timestamps[connected],
                                    trajectory.poses[connected])
        print(f"ATE {figures['ate_m']['rmse']:.3f} m")

    # Landmarks that several keyframes see, for Open3D: open3d.io.read_point_cloud(ply). Sub-maps that
    # were never connected have frames of their own: only the one of the trajectory.
    snapshot = slam.snapshot()
    chosen = ((snapshot.landmark_submaps == snapshot.main_submap)
              & (snapshot.landmark_observations >= 3))
    points = snapshot.landmark_points[chosen].astype("<f4")
    with open(ply, "wb") as file:
        file.write(b"ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\n"
                   b"property float y\nproperty float z\nend_header\n" % len(points))
        file.write(points.tobytes())


if __name__ == "__main__":
    main(*sys.argv[1:3])
