#pragma once

#include <kys_slam/features.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace kys_slam {

/// Tells when one camera of the pair shows nothing while the other does: a camera that is dead or
/// covered, an image that arrived in part, a picture given out again. By keypoints, so that it
/// costs next to nothing.
class CameraFaults {
 public:
  /// \param left, right  features of the next frame, before any is dropped
  /// \param width, height  of the images, px
  /// \returns one phrase, or "" when nothing is wrong
  std::string look_at(const FeatureSet& left, const FeatureSet& right, int width, int height);
  /// Whether the left image looked at last is that of the frame before.
  [[nodiscard]] bool left_repeated() const { return repeated_[0]; }

 private:
  /// Of a picture, to recognise it.
  struct Trace {
    std::size_t features = 0;
    std::vector<kys::Descriptor> some;
    bool operator==(const Trace&) const = default;
  };
  [[nodiscard]] static Trace trace(const FeatureSet& features);
  std::array<Trace, 2> last_;
  std::array<bool, 2> repeated_{};
};

}  // namespace kys_slam
