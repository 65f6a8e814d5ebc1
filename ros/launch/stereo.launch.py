# SPDX-License-Identifier: BSD-3-Clause
"""The node as a component in a container of its own, or in one that runs (container:=NAME).

    ros2 launch kys_slam_ros stereo.launch.py left:=/cam0 right:=/cam1 params:=robot.yaml
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import ComposableNodeContainer, LoadComposableNodes
from launch_ros.descriptions import ComposableNode
from launch_ros.parameter_descriptions import ParameterFile

ARGUMENTS = (
    ("left", "left", "namespace of the left camera: LEFT/IMAGE and LEFT/camera_info"),
    ("right", "right", "namespace of the right camera"),
    ("image", "image_raw", "name of the image topics"),
    ("transport", "raw", "image_transport: raw, compressed"),
    ("params", "", "YAML file of parameters"),
    ("container", "", "container to load into; empty: one of its own"),
    ("use_sim_time", "false", "a bag is played with --clock"),
)


def generate_launch_description():
    value = LaunchConfiguration
    remappings = [("segments", "/segments")]
    for side in ("left", "right"):
        remappings += [(f"{side}/image", [value(side), "/", value("image")]),
                       (f"{side}/camera_info", [value(side), "/camera_info"]),
                       (f"{side}/mask", [value(side), "/mask"])]
    has_file = PythonExpression(["'", value("params"), "' != ''"])
    has_container = PythonExpression(["'", value("container"), "' != ''"])
    has_none = PythonExpression(["'", value("container"), "' == ''"])

    def node(condition=None, more=()):
        return ComposableNode(
            package="kys_slam_ros", plugin="kys_slam::ros::StereoNode", name="kys_slam",
            remappings=remappings, condition=condition,
            parameters=[{"image_transport": value("transport"),
                         "use_sim_time": PythonExpression(["'", value("use_sim_time"), "' == 'true'"])},
                        *more])

    has_no_file = PythonExpression(["'", value("params"), "' == ''"])
    nodes = [node(IfCondition(has_no_file)),
             node(IfCondition(has_file), [ParameterFile(value("params"), allow_substs=True)])]
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=description)
          for name, default, description in ARGUMENTS),
        ComposableNodeContainer(
            name="kys_slam_container", namespace="", package="rclcpp_components",
            executable="component_container_mt", composable_node_descriptions=nodes,
            condition=IfCondition(has_none), output="screen"),
        LoadComposableNodes(target_container=value("container"), composable_node_descriptions=nodes,
                            condition=IfCondition(has_container)),
    ])
