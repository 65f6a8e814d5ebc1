#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "feature_path.h"

namespace kys_slam::simulator {

/// \throws InputError when it is none of none, light, city, jam.
Traffic parse_traffic(const std::string& name);

/// Dense index in COCO's panoptic label space of a category id; kys::kVoidLabel for kUnlabelled.
std::uint16_t coco_label(int category);
inline constexpr const char* kFeatureLabelSpace = "coco_panoptic_133";

/// Parked cars at the kerbs of a road, in runs: to the right of the camera's lane and to the left
/// of the opposite lane, never on the path of the camera. Empty for a path without ground.
std::vector<FeatureObject> park_cars(const FeaturePath& path, std::uint64_t seed);

/// Moving objects along a path. On a road: vehicles ahead in the camera's lane, which drive as the
/// camera does one or two seconds later, and continue straight where the camera turns; oncoming,
/// overtaking and crossing vehicles; crossing people, mostly where the camera waits; cycles; people
/// on the pavement. Indoors (no ground): people who walk through the view, some of whom carry
/// objects. No object comes nearer to the camera than 1 m.
std::vector<FeatureObject> make_traffic(const FeaturePath& path, Traffic density,
                                        std::uint64_t seed);

/// The objects of a rendered world, from its objects.csv; frames as in the world, which has
/// `frames`. \throws InputError naming the file and line
std::vector<FeatureObject> read_objects(const std::filesystem::path& file, std::size_t frames);

/// T_w_o of an object in a frame, or null when it does not exist in that frame.
const Rigid3* pose_in_frame(const FeatureObject& object, std::size_t frame);

/// Position (m) of a landmark in the frame of its object at a time (s): people oscillate.
Eigen::Vector3d sway(const FeatureObject& object, const Eigen::Vector3d& p_o, double time);

}  // namespace kys_slam::simulator
