#pragma once

#include <kys_slam/frame_source.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

/// Feature files: stereo frames as features instead of images, with the camera and the true poses.
/// The format is described byte by byte in tools/simulator/README.md.
namespace kys_slam {

/// What a feature file says about itself.
struct FeatureFileInfo {
  StereoCamera camera;
  double scale_factor = 1.2;  ///< between two octaves
  int levels = 8;             ///< octaves
  std::uint64_t seed = 0;
  std::vector<TimedPose> poses;  ///< true pose of the left camera, one per frame
};

/// The features of one frame, and which landmark each one is of (-1: none, an outlier).
struct FeatureFrame {
  FeatureSet left, right;
  std::vector<std::int32_t> left_landmarks, right_landmarks;
};

/// Writes a feature file frame by frame; the file takes its name in `finish`, and not before.
class FeatureSequenceWriter {
 public:
  /// \throws InputError when the file cannot be made.
  FeatureSequenceWriter(const std::filesystem::path& path, const FeatureFileInfo& info);
  ~FeatureSequenceWriter();  ///< without finish(): leaves nothing
  FeatureSequenceWriter(const FeatureSequenceWriter&) = delete;
  FeatureSequenceWriter& operator=(const FeatureSequenceWriter&) = delete;

  /// Pixel positions are stored in steps of 1/32 px, within [0, 2047] px.
  void write(const FeatureFrame& frame);
  /// \throws InputError when the disk is full, std::logic_error when frames are missing.
  void finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Reads a feature file. Every block carries a checksum; a truncated or corrupt file throws
/// InputError naming it, when the damaged frame is reached.
class FeatureSequence : public FrameSource {
 public:
  /// Frames [start, start + frames) of the file; frames < 0: to the end. Frame indices and names
  /// ("000123") count from the file's first frame.
  explicit FeatureSequence(const std::filesystem::path& path, std::int64_t start = 0,
                           std::int64_t frames = -1);
  ~FeatureSequence() override;

  [[nodiscard]] const StereoCamera& camera() const override;
  [[nodiscard]] std::optional<std::int64_t> size() const override;
  std::optional<StereoFrame> next() override;

  [[nodiscard]] const FeatureFileInfo& info() const;
  /// True poses of the frames of this sequence (all of them, also those not read yet).
  [[nodiscard]] const std::vector<TimedPose>& ground_truth() const;
  /// Landmarks of the features that the last next() gave, index by index; -1: an outlier.
  [[nodiscard]] const std::vector<std::int32_t>& left_landmarks() const;
  [[nodiscard]] const std::vector<std::int32_t>& right_landmarks() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Whether the file begins as a feature file does.
bool is_feature_file(const std::filesystem::path& path);

}  // namespace kys_slam
