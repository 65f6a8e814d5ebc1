# SPDX-License-Identifier: BSD-3-Clause
"""Writes ROS bags of recorded images, for tests."""

import numpy as np
import pytest

import kys_slam

INFO = "sensor_msgs/msg/CameraInfo"


def ros_header(types, stamp, ros1):
    """stamp: ns."""
    extra = {"seq": 0} if ros1 else {}
    return types["std_msgs/msg/Header"](
        stamp=types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9),
        frame_id="cam", **extra)


def ros_image(typestore, image, stamp, encoding, ros1):
    t = typestore.types
    header = ros_header(t, stamp, ros1)
    if encoding == "png":
        data = np.frombuffer(image.read_bytes(), np.uint8)
        return t["sensor_msgs/msg/CompressedImage"](header=header, format="png", data=data)
    pixels = kys_slam._core.decode_gray(image.read_bytes(), str(image))
    height, width = pixels.shape
    if encoding == "bgr8":
        pixels = np.repeat(pixels[:, :, None], 3, 2)
    elif encoding == "rgb8":  # of a colour file
        cv2 = pytest.importorskip("cv2")
        pixels = np.ascontiguousarray(cv2.imread(str(image))[:, :, ::-1])
    return t["sensor_msgs/msg/Image"](
        header=header, height=height, width=width, encoding=encoding, is_bigendian=0,
        step=width * (1 if pixels.ndim == 2 else 3), data=pixels.ravel())


def ros_camera_info(typestore, info, stamp, ros1):
    """A CameraInfo message of a dict (kys_slam.rig_from_camera_info)."""
    t = typestore.types
    case = str if ros1 else str.lower
    numbers = {case(k): np.array(info[k], float) for k in "DKRP"}
    x, y, width, height = info.get("roi", (0, 0, 0, 0))
    roi = t["sensor_msgs/msg/RegionOfInterest"](
        x_offset=x, y_offset=y, height=height, width=width, do_rectify=False)
    return t["sensor_msgs/msg/CameraInfo"](
        header=ros_header(t, stamp, ros1), height=info["height"], width=info["width"],
        distortion_model=info["distortion_model"], binning_x=info.get("binning_x", 0),
        binning_y=info.get("binning_y", 0), roi=roi, **numbers)


def write_bag(path, kind, shots, encoding, drop=lambda i, side: False, jitter=lambda i: 0,
              infos=None):
    """A bag of (stamp ns, left path, right path); `infos`: camera_info of both cameras."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore
    ros1 = kind == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if ros1:
        writer = Writer1(path)
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
    kind_name = "CompressedImage" if encoding == "png" else "Image"
    type_name = f"sensor_msgs/msg/{kind_name}"
    end = "/image_raw/compressed" if encoding == "png" else "/image_raw"
    with writer:
        connections = [writer.add_connection(f"/cam{c}{end}", type_name, typestore=store)
                       for c in range(2)]
        camera_infos = [writer.add_connection(f"/cam{c}/camera_info", INFO, typestore=store)
                        for c in range(2)] if infos else []
        serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
        for i, (stamp, left, right) in enumerate(shots):
            for side, image in enumerate((left, right)):
                if drop(i, side):
                    continue
                at = stamp + (jitter(i) if side else 0)
                message = ros_image(store, image, at, encoding, ros1)
                writer.write(connections[side], at, serialize(message, type_name))
                if infos:
                    message = ros_camera_info(store, infos[side], at, ros1)
                    writer.write(camera_infos[side], at, serialize(message, INFO))
