#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <string>

/// The distance call for programs of an older C++ standard: this header alone, of all in this
/// folder, compiles from C++11 on (CMake target kys::matcher, which leaves the program's standard
/// alone). Libraries that show Eigen types must not mix standards before and after C++17; with this
/// header nothing of the program has to change its own. The other headers are C++20.
namespace kys {
namespace matcher {

/// kys::Prior under another name: the same members in the same order.
struct Prior {
  std::uint16_t label = 0xFFFF;  ///< dense class index; 0xFFFF: none, native distance
  std::uint8_t dynamic = 0;      ///< 1: the segment is flagged as moving
  std::uint8_t unjudged = 0;     ///< 1: nothing says whether the segment moves
  std::int32_t instance = -1;    ///< identity, -1: none
  float scale = 0;               ///< a, area x (mean depth)^2, px^2 m^2 (Eq. 3)
  float motion = 0;              ///< mu, 0..100
  float log_motion = 0;          ///< ln(1 + mu)
};

/// kys::Context under another name.
enum class Context : std::uint8_t { kStereo, kTemporal, kInstance };

/// A mode with its label space. Immutable; any number of threads may share one or its copies.
class Matcher {
 public:
  /// \param mode "stock", "kys", ...  \param label_space built in, or beginning of two files
  /// \throws kys::Error (a std::runtime_error) with one line, for what makes no sense
  Matcher(const std::string& mode, const std::string& label_space);
  /// \param options text of one `key = value` per line, e.g. "kys.alpha = 0.8"; # begins a comment
  Matcher(const std::string& mode, const std::string& label_space, const std::string& options);

  /// The prior of a keypoint. \param class_id the data set's number; one that the label space does
  /// not have is an error  \throws kys::Error for that, or for a scale or motion that is not finite
  Prior make_prior(std::int32_t class_id, std::int32_t instance, float scale, float motion,
                   bool moving) const;

  /// False: drop this keypoint at extraction (mode `mask`).
  bool keeps_keypoint(const Prior& prior) const;

  /// Distance of two descriptors of 32 bytes (rows of a cv::Mat, any alignment), in bits; infinity:
  /// the pair is rejected. \param bound values from here on need not be exact
  float distance(const unsigned char* a, const Prior& prior_a, const unsigned char* b,
                 const Prior& prior_b, Context context,
                 float bound = std::numeric_limits<float>::infinity()) const;

 private:
  struct Parts;
  std::shared_ptr<const Parts> parts_;
};

/// The prior of a map point: of the observation its descriptor is from, and of its latest one.
Prior landmark_prior(const Prior& representative, const Prior& most_recent);

}  // namespace matcher
}  // namespace kys
