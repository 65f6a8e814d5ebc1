# SPDX-License-Identifier: BSD-3-Clause
"""The ROS package's files agree with each other, as far as that shows without ROS; its launch file with
substitutes for launch and launch_ros."""

import re
import runpy
import sys
import types
import unittest
import xml.etree.ElementTree as ElementTree
from pathlib import Path

ROS = Path(__file__).resolve().parents[2] / "ros"
OWN = {"kys_slam", "kys_slam_ros"}
# Build tools, and what the include of a package's header needs.
BUILD = {"ament_cmake", "rosidl_default_generators", "launch_testing_ament_cmake"}
INDIRECT = {"builtin_interfaces", "rcl_interfaces"}  # of rclcpp


class Recorded:
    """A launch action or substitution: what it was made of."""

    def __init__(self, *arguments, **named):
        self.arguments, self.named = arguments, named


def substitutes():
    """Modules of launch and launch_ros whose names are subclasses of Recorded."""
    names = {"launch": ["LaunchDescription"], "launch.actions": ["DeclareLaunchArgument"],
             "launch.conditions": ["IfCondition"],
             "launch.substitutions": ["LaunchConfiguration", "PythonExpression"], "launch_ros": [],
             "launch_ros.actions": ["ComposableNodeContainer", "LoadComposableNodes"],
             "launch_ros.descriptions": ["ComposableNode"],
             "launch_ros.parameter_descriptions": ["ParameterFile"]}
    modules = {}
    for module, classes in names.items():
        modules[module] = types.ModuleType(module)
        for name in classes:
            setattr(modules[module], name, type(name, (Recorded,), {}))
    return modules


class Package(unittest.TestCase):
    def setUp(self):
        self.cmake = (ROS / "CMakeLists.txt").read_text()
        self.manifest = ElementTree.parse(ROS / "package.xml").getroot()
        self.source = "\n".join(f.read_text() for f in sorted((ROS / "src").glob("*.[hc]*")))

    def declared(self, *tags):
        return {e.text for tag in tags for e in self.manifest.iter(tag)}

    def test_packages_that_are_found_are_declared(self):
        found = set(re.findall(r"find_package\((\w+)", self.cmake)) | set(
            re.search(r"set\(packages ([^)]*)\)", self.cmake).group(1).split())
        declared = self.declared("depend", "buildtool_depend", "test_depend")
        self.assertEqual(found - OWN - declared - {"{package}"}, set())
        self.assertEqual(self.declared("depend") - found, set())

    def test_headers_are_of_packages_that_are_declared(self):
        included = set(re.findall(r"#include <(\w+)/(?:msg|srv)/", self.source)) | set(
            re.findall(r"#include <(rclcpp|rclcpp_components|image_transport|tf2|tf2_ros)/", self.source))
        self.assertGreater(len(included), 5)
        self.assertEqual(included - OWN - INDIRECT - self.declared("depend"), set())

    def test_services_are_generated_and_used(self):
        files = {f"srv/{f.name}" for f in (ROS / "srv").iterdir()}
        generated = re.search(r"rosidl_generate_interfaces\(\S+ ([^)]*)\)", self.cmake).group(1).split()
        self.assertEqual(files, set(generated))
        for name in files:
            fields = re.findall(r"^(\w+) (\w+)", (ROS / name).read_text(), re.MULTILINE)
            self.assertIn(("bool", "success"), fields)
            for _, field in fields:
                self.assertRegex(self.source, rf"(request->|response\.){field}\b")

    def test_sources_of_the_node_exist(self):
        for name in re.findall(r"src/\w+\.cpp", self.cmake):
            self.assertTrue((ROS / name).exists(), name)
        sources = set(re.findall(r"\w+\.cpp", (ROS / "src" / "CMakeLists.txt").read_text() + self.cmake))
        self.assertEqual({f.name for f in (ROS / "src").glob("*.cpp")}, sources)

    def test_launch_file(self):
        before = dict(sys.modules)
        sys.modules.update(substitutes())
        try:
            made = runpy.run_path(str(ROS / "launch" / "stereo.launch.py"))
            actions = made["generate_launch_description"]().arguments[0]
        finally:
            for name in set(sys.modules) - set(before):
                del sys.modules[name]
        arguments = {a.arguments[0] for a in actions if type(a).__name__ == "DeclareLaunchArgument"}
        self.assertEqual(arguments, {name for name, *_ in made["ARGUMENTS"]})
        nodes = [n for a in actions for n in a.named.get("composable_node_descriptions", [])]
        self.assertEqual(len(nodes), 4)  # with and without a file, in a container of its own or another
        topics = set(re.findall(r'"(segments)"', self.source)) | {
            f"{side}/{topic}" for side in ("left", "right") for topic in ("image", "camera_info", "mask")}
        for node in nodes:
            self.assertIn(f'"{node.named["plugin"]}"', self.cmake)
            self.assertEqual({name for name, _ in node.named["remappings"]}, topics)

    def test_the_test_of_bags_is_python(self):
        compile((ROS / "test" / "play_bag_test.py").read_text(), "play_bag_test.py", "exec")


if __name__ == "__main__":
    unittest.main()
