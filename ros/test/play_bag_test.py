# SPDX-License-Identifier: BSD-3-Clause
"""Plays the bag in KYS_SLAM_BAG to the node, and checks what it publishes. It needs a bag with the four
topics in KYS_SLAM_TOPICS ("/cam0 /cam1": namespaces with image_raw and camera_info). Skipped without.

    KYS_SLAM_BAG=corridor KYS_SLAM_TOPICS="/cam0 /cam1" colcon test --packages-select kys_slam_ros
"""

import math
import os
import time
import unittest

import launch
import launch.actions
import launch_ros.actions
import launch_testing.actions
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image
from tf2_msgs.msg import TFMessage

BAG = os.environ.get("KYS_SLAM_BAG", "")
LEFT, RIGHT = (os.environ.get("KYS_SLAM_TOPICS", "/cam0 /cam1").split() + ["", ""])[:2]


@pytest.mark.launch_test
def generate_test_description():
    node = launch_ros.actions.Node(
        package="kys_slam_ros", executable="stereo_node",
        remappings=[("left/image", f"{LEFT}/image_raw"), ("left/camera_info", f"{LEFT}/camera_info"),
                    ("right/image", f"{RIGHT}/image_raw"), ("right/camera_info", f"{RIGHT}/camera_info")])
    actions = [node, launch_testing.actions.ReadyToTest()]
    if BAG:
        play = launch.actions.ExecuteProcess(cmd=["ros2", "bag", "play", BAG, "--rate", "0.5"])
        actions.append(launch.actions.TimerAction(period=3.0, actions=[play]))
    return launch.LaunchDescription(actions)


@unittest.skipUnless(BAG, "KYS_SLAM_BAG names no bag")
class PlaysABag(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rclpy.init()

    @classmethod
    def tearDownClass(cls):
        rclpy.shutdown()

    def test_poses_follow_the_images(self):
        node = rclpy.create_node("listener")
        images, poses, transforms, states = [], [], [], []
        stamp = lambda message: (message.header.stamp.sec, message.header.stamp.nanosec)
        node.create_subscription(Image, f"{LEFT}/image_raw", lambda m: images.append(stamp(m)),
                                 qos_profile_sensor_data)
        node.create_subscription(Odometry, "odometry", poses.append, 10)
        node.create_subscription(TFMessage, "/tf", lambda m: transforms.extend(m.transforms), 100)
        node.create_subscription(DiagnosticArray, "/diagnostics", lambda m: states.extend(m.status), 10)
        end = time.monotonic() + 120
        while len(poses) < 30 and time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.1)
        node.destroy_node()
        self.assertGreaterEqual(len(poses), 30)
        # Stamps are those of images, in order.
        self.assertEqual([], sorted(set(map(stamp, poses)) - set(images)))
        self.assertEqual(sorted(map(stamp, poses)), list(map(stamp, poses)))
        for pose in poses:
            self.assertEqual(("odom", "base_link"), (pose.header.frame_id, pose.child_frame_id))
            q = pose.pose.pose.orientation
            self.assertAlmostEqual(1, math.hypot(q.x, q.y, q.z, q.w), places=6)
        # Odom is continuous: less than 1 m from frame to frame.
        place = lambda p: (p.pose.pose.position.x, p.pose.pose.position.y, p.pose.pose.position.z)
        for before, after in zip(poses, poses[1:]):
            self.assertLess(math.dist(place(before), place(after)), 1.0)
        pairs = {(t.header.frame_id, t.child_frame_id) for t in transforms}
        self.assertLessEqual({("map", "odom"), ("odom", "base_link")}, pairs)
        self.assertTrue(any(state.name.endswith("tracking") for state in states))
