# SPDX-License-Identifier: BSD-3-Clause
"""A drive of KITTI raw (synced and rectified) as a folder in the layout of KITTI odometry: links to its
images, calib.txt, times.txt, and poses.txt of camera 0 from the GPS/IMU where its calibration is there.
"""
import datetime
import math
import os

import numpy as np

from runs import write_text
from inputs import fail, reading  # runs knows where it is

CALIBRATION = "calib_cam_to_cam.txt"
EARTH_RADIUS_M = 6378137.0


def _calibration(path):
    """Values of each row that holds numbers."""
    rows = {}
    with reading(path), open(path, encoding="utf-8") as file:
        for line in file:
            key, _, text = line.partition(":")
            try:
                rows[key] = np.array([float(x) for x in text.split()])
            except ValueError:
                pass  # the date of the calibration
    return rows


def _rigid(rows, path):
    with reading(path):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rows["R"].reshape(3, 3), rows["T"]
        return T


def _times(path):
    """Seconds since the first row, to the nanosecond."""
    times = []
    with reading(path), open(path, encoding="utf-8") as file:
        for line in filter(str.strip, file):
            whole, _, fraction = line.strip().partition(".")
            moment = datetime.datetime.strptime(whole, "%Y-%m-%d %H:%M:%S")
            since = (moment - datetime.datetime(2000, 1, 1)).total_seconds()
            times.append(int(since) * 10**9 + int(fraction.ljust(9, "0")[:9]))
    if not times:
        fail(f"{path}: is empty")
    return [(t - times[0]) * 1e-9 for t in times]


def _pose_of_packet(packet, scale):
    """4 x 4, the GPS/IMU in the world: Mercator projection, angles about x, then y, then z."""
    latitude, longitude, altitude, roll, pitch, yaw = packet[:6]
    about = lambda i, a: {
        0: np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]]),
        1: np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]]),
        2: np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])}[i]
    T = np.eye(4)
    T[:3, :3] = about(2, yaw) @ about(1, pitch) @ about(0, roll)
    T[:3, 3] = [scale * EARTH_RADIUS_M * math.radians(longitude),
                scale * EARTH_RADIUS_M * math.log(math.tan(math.pi * (90 + latitude) / 360)), altitude]
    return T


def _poses(drive, rows):
    """Poses of rectified camera 0 relative to the first; None without GPS/IMU or its calibration."""
    above = os.path.dirname(drive)
    files = [os.path.join(above, name) for name in ("calib_imu_to_velo.txt", "calib_velo_to_cam.txt")]
    folder = os.path.join(drive, "oxts", "data")
    if not os.path.isdir(folder) or not all(map(os.path.isfile, files)):
        return None
    to_velo, to_camera = (_rigid(_calibration(f), f) for f in files)
    rectify = np.eye(4)
    with reading(os.path.join(above, CALIBRATION)):
        rectify[:3, :3] = rows["R_rect_00"].reshape(3, 3)
    to_imu = np.linalg.inv(rectify @ to_camera @ to_velo)
    poses, scale = [], None
    for name in sorted(os.listdir(folder)):
        path = os.path.join(folder, name)
        with reading(path), open(path, encoding="utf-8") as file:
            packet = [float(x) for x in file.read().split()]
            scale = scale or math.cos(math.radians(packet[0]))
            poses.append(_pose_of_packet(packet, scale) @ to_imu)
    return [np.linalg.inv(poses[0]) @ pose for pose in poses] if poses else None


def arrange(drive, images, output):
    """Writes the folder. `images`: those of the left and the right camera (image_00/data ...)."""
    path = os.path.join(os.path.dirname(drive), CALIBRATION)
    rows = _calibration(path)
    os.makedirs(output)
    number = lambda row: " ".join(f"{v:.12e}" for v in row)
    cameras = [os.path.basename(os.path.dirname(folder))[-1] for folder in images]  # image_00: 0
    with reading(path):
        write_text(os.path.join(output, "calib.txt"),
                   "".join(f"P{c}: {number(rows[f'P_rect_0{c}'])}\n" for c in cameras))
    times = _times(os.path.join(os.path.dirname(images[0]), "timestamps.txt"))
    write_text(os.path.join(output, "times.txt"), "".join(f"{t:.9f}\n" for t in times))
    for camera, folder in zip(cameras, images):
        os.symlink(folder, os.path.join(output, "image_" + camera))
    poses = _poses(drive, rows)
    if poses is not None:
        write_text(os.path.join(output, "poses.txt"),
                   "".join(number(pose[:3].reshape(-1)) + "\n" for pose in poses))
