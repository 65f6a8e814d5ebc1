// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <string>

/// The distance function for programs of an older C++ standard. This header compiles from C++11 on;
/// the other headers need C++20. The CMake target kys::matcher does not change the standard of the
/// program. A program must not mix standards before and after C++17 in libraries with Eigen types
/// in their interface; with this header it need not.
namespace kys {
namespace matcher {

/// A copy of kys::Prior: the same members in the same order.
struct Prior {
  std::uint16_t label = 0xFFFF;  ///< dense class index; 0xFFFF: none, Hamming distance
  std::uint8_t dynamic = 0;      ///< 1: the segment is flagged as moving
  std::uint8_t unjudged = 0;     ///< 1: the motion of the segment was not measured
  std::int32_t instance = -1;    ///< identity, -1: none
  float scale = 0;               ///< a, area x (mean depth)^2, px^2 m^2 (Eq. 3)
  float motion = 0;              ///< mu, 0..100
  float log_motion = 0;          ///< ln(1 + mu)
};

/// A copy of kys::Context.
enum class Context : std::uint8_t { kStereo, kTemporal, kInstance };

/// A mode with its label space. Immutable; any number of threads may share one or its copies.
class Matcher {
 public:
  /// \param mode "stock", "kys", ...
  /// \param label_space built-in name, or path prefix of the two files
  /// \throws kys::Error (a std::runtime_error) with one line, for an unknown or invalid argument
  Matcher(const std::string& mode, const std::string& label_space);
  /// \param options text of one `key = value` per line, e.g. "kys.alpha = 0.8"; # begins a comment
  Matcher(const std::string& mode, const std::string& label_space, const std::string& options);

  /// The prior of a keypoint; arguments as kys::make_prior(), scale in px^2 m^2, motion 0..100.
  /// \param class_id number in the data set
  /// \throws kys::Error for a class_id that is not in the label space, or a scale or motion that is
  ///   not finite
  Prior make_prior(std::int32_t class_id, std::int32_t instance, float scale, float motion,
                   bool moving) const;

  /// False: drop this keypoint at extraction (mode `mask`).
  bool keeps_keypoint(const Prior& prior) const;

  /// Distance of two descriptors of 32 bytes (rows of a cv::Mat, any alignment), in bits; infinity:
  /// the pair is rejected.
  /// \param bound bits; a distance that is not below it need not be exact
  float distance(const unsigned char* a, const Prior& prior_a, const unsigned char* b,
                 const Prior& prior_b, Context context,
                 float bound = std::numeric_limits<float>::infinity()) const;

 private:
  struct Parts;
  std::shared_ptr<const Parts> parts_;
};

/// The prior of a map point, from the observation of its descriptor and from the most recent one.
Prior landmark_prior(const Prior& representative, const Prior& most_recent);

}  // namespace matcher
}  // namespace kys
