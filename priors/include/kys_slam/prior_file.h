// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance.h>
#include <kys_slam/features.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace kys_slam {

/// Which camera of the pair.
enum class CameraSide : std::uint8_t { kLeft = 0, kRight = 1 };

/// Requirements that a prior file must meet. Fields that are empty or 0 are not checked.
struct ExpectedPriors {
  int width = 0;   ///< px
  int height = 0;  ///< px
  /// of calibration_hash(); a file with hash 0 fits any camera
  std::uint64_t calibration_hash = 0;
  std::string label_space = {};  ///< e.g. "coco_panoptic_133"
  std::size_t label_count = 0;   ///< labels must be below it
};

/// One segment of one camera's panoptic map.
struct PriorSegment {
  std::uint16_t label = 0;    ///< dense class index in the label space
  std::uint16_t flags = 0;    ///< prior_format::kThing | kDynamic | kRadialOnly | kNotJudged
  std::int32_t instance = 0;  ///< identity over time, disjoint between cameras
  float scale = 0;            ///< a_k, px^2 m^2 (Eq. 3); 0 without depth
  float score = 0;            ///< m_k, 0..100 (Eq. 8)
  std::uint32_t area = 0;     ///< px

  friend bool operator==(const PriorSegment&, const PriorSegment&) = default;
};

/// The priors of one stereo frame as stored on disk: run lengths by row, looked up by pixel without
/// decoding to an image. Reading checks everything (sizes, checksum, offsets, every run), so that
/// every PriorFile object is valid and look-ups need no checks. Immutable.
class PriorFile {
 public:
  /// Reads and checks a file. \throws InputError naming the file and what is wrong with it.
  static PriorFile open(const std::filesystem::path& path, const ExpectedPriors& expected = {});

  /// The same from memory; `name` is used in messages.
  static PriorFile parse(std::vector<std::uint8_t> bytes, const std::string& name,
                         const ExpectedPriors& expected = {});

  /// Priors of keypoints by their rounded pixel. A keypoint outside the image, on a void pixel, or
  /// of a camera that is not in the file gets a default Prior (no label). `out` has the length of
  /// `keypoints`. Cost: one pass over the runs of the rows with keypoints.
  void lookup(CameraSide side, std::span<const Keypoint> keypoints,
              std::span<kys::Prior> out) const;

  [[nodiscard]] int width() const { return width_; }    ///< px
  [[nodiscard]] int height() const { return height_; }  ///< px
  [[nodiscard]] std::size_t camera_count() const { return cameras_.size(); }
  [[nodiscard]] const std::string& label_space() const { return label_space_; }
  [[nodiscard]] std::uint64_t calibration_hash() const { return calibration_hash_; }
  /// Digest of settings and inputs that the file was made from; 0 when not known.
  [[nodiscard]] std::uint64_t content_key() const { return content_key_; }
  /// Whether the file was made with optical flow (motion was judged). Where it was not, priors of
  /// segments that are not dynamic are unjudged.
  [[nodiscard]] bool has_motion() const { return has_motion_; }
  /// Whether an object has the same instance in both cameras. lookup() then returns the number of
  /// the left camera for both.
  [[nodiscard]] bool shares_instances() const { return shares_instances_; }
  [[nodiscard]] std::size_t file_size() const { return bytes_.size(); }  ///< bytes
  [[nodiscard]] const std::vector<PriorSegment>& segments(CameraSide side) const;
  /// The segments as priors of a keypoint, without motion.
  [[nodiscard]] std::span<const kys::Prior> segment_priors(CameraSide side) const;

  /// One decoded row, for tools: per pixel the segment (0 void, k = segments()[k-1]) and mu
  /// (0..100). Both spans have length width().
  void expand_row(CameraSide side, int y, std::span<std::uint16_t> segment_of,
                  std::span<float> motion_of) const;

 private:
  struct CameraView {
    std::vector<PriorSegment> segments;
    std::vector<kys::Prior> priors;  ///< of the segments, without motion; [0] is void
    std::size_t row_index_at = 0;    ///< offset of height + 1 row offsets in bytes_
    std::size_t runs_at = 0;
    std::size_t runs_size = 0;
  };

  PriorFile() = default;
  void parse_header(const std::string& name, const ExpectedPriors& expected);
  void parse_camera(std::size_t index, const std::string& name, const ExpectedPriors& expected);
  void check_runs(const CameraView& camera, const std::string& name) const;
  [[nodiscard]] std::pair<const std::uint8_t*, const std::uint8_t*> row_bytes(
      const CameraView& camera, int y) const;

  std::vector<std::uint8_t> bytes_;
  std::vector<CameraView> cameras_;
  std::string label_space_;
  std::uint64_t calibration_hash_ = 0;
  std::uint64_t content_key_ = 0;
  int width_ = 0;
  int height_ = 0;
  bool has_motion_ = false;
  bool shares_instances_ = false;
};

}  // namespace kys_slam
