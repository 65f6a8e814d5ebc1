// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <exception>

#include "stereo_node.h"

int main(int argc, char** argv) {
  rclcpp::init(argc, argv);
  int status = 2;
  try {
    const auto node = std::make_shared<kys_slam::ros::StereoNode>(rclcpp::NodeOptions());
    rclcpp::spin(node);
    if (node->finish()) status = 0;
  } catch (const std::exception& error) {  // a parameter that cannot be
    std::fprintf(stderr, "stereo_node: %s\n", error.what());
  }
  rclcpp::shutdown();
  return status;
}
