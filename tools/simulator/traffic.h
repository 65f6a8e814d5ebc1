#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "feature_world.h"

namespace kys_slam::simulator {

/// \throws InputError when it is none of none, light, city, jam.
Traffic parse_traffic(const std::string& name);

/// Dense index in COCO's panoptic label space of a category id; kys::kVoidLabel for kUnlabelled.
std::uint16_t coco_label(int category);
inline constexpr const char* kFeatureLabelSpace = "coco_panoptic_133";

/// Cars that stand at the kerbs of a road: in runs, right beside the own lane and left beyond the
/// other one, never where the camera ever drives. Empty for a path without ground.
std::vector<FeatureObject> park_cars(const FeaturePath& path, std::uint64_t seed);

/// What moves along a path. On a road: vehicles ahead in the own lane, which drive as the camera
/// will a second or two later, so that they start first at a light, and which leave straight on
/// where the camera turns; oncoming vehicles; vehicles and people that cross, above all where the
/// camera waits; overtaking ones; cycles; people on the pavement. In a room (no ground): people who
/// walk through the view, some of them with things in their hands. Nothing comes nearer to the
/// camera than a metre.
std::vector<FeatureObject> make_traffic(const FeaturePath& path, Traffic density,
                                        std::uint64_t seed);

/// The objects of a rendered world, from its objects.csv; frames as in the world.
/// \throws InputError naming the file and line
std::vector<FeatureObject> read_objects(const std::filesystem::path& file);

/// T_w_o of an object in a frame, or null when it is not there.
const Rigid3* pose_in_frame(const FeatureObject& object, std::size_t frame);

/// Where a landmark of an object is in the object's frame at a time: people sway.
Eigen::Vector3d sway(const FeatureObject& object, const Eigen::Vector3d& p_o, double time);

}  // namespace kys_slam::simulator
