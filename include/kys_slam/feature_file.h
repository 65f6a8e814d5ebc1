#pragma once

#include <kys/distance.h>
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
  int version = 1;               ///< of the format: 2 carries priors and the truth about objects
  std::string label_space = {};  ///< of the priors; "": the frames have none
};

/// How a descriptor came about, so that a file need not store all of its bits: those of a look,
/// some of them flipped.
struct FeatureLook {
  enum class Kind : std::uint8_t {
    kRaw,     ///< unknown: all bits are stored
    kOwn,     ///< the landmark's own
    kFamily,  ///< one that several landmarks share; `value` is its number, below 65536
    kState,   ///< `value` is the state of a generator
  };
  Kind kind = Kind::kRaw;
  std::uint64_t value = 0;
};

/// The 256 bits that the state of a generator stands for.
kys::Descriptor expand_look(std::uint64_t key);

/// The bits that a feature's look stands for, before any bit flips; zero for kRaw.
kys::Descriptor base_descriptor(const FeatureLook& look, std::int32_t landmark, std::uint64_t seed);

/// The features of one frame, and which landmark each one is of (-1: none, an outlier).
struct FeatureFrame {
  FeatureSet left, right;
  std::vector<std::int32_t> left_landmarks, right_landmarks;
  // What follows is in files of version 2 only.
  std::vector<FeatureLook> left_looks, right_looks;  ///< empty: all kRaw
  bool has_priors = false;
  std::vector<kys::Prior> left_priors, right_priors;  ///< one per feature; motion in 255 steps
  float mover_share = 0;                              ///< of the left image's area, 0..1
};

/// A solid box of the simulated world, and where it is.
struct FeatureObject {
  enum class Kind : std::uint16_t {
    kStanding,     ///< never moves; one pose
    kRigid,        ///< one pose per frame
    kArticulated,  ///< the same, and its landmarks sway about theirs
  };
  std::uint16_t label = 0;  ///< in the label space of the file
  Kind kind = Kind::kStanding;
  Eigen::Vector3f half_size = Eigen::Vector3f::Ones();  ///< m, along its own axes
  std::int64_t first_frame = 0;
  std::vector<Rigid3> poses;  ///< T_w_o of the frames from first_frame on; o: the box's centre
};

/// What is known of the world: an index is an id.
struct FeatureTruth {
  struct Landmark {
    Eigen::Vector3f position = Eigen::Vector3f::Zero();  ///< m, in the world or in its object
    std::int32_t object = -1;                            ///< -1: of the static scenery
    std::uint16_t label = 0xFFFF;                        ///< kys::kVoidLabel: of no class
  };
  std::vector<FeatureObject> objects;
  std::vector<Landmark> landmarks;
};

/// Writes a feature file frame by frame; the file takes its name in `finish`, and not before.
class FeatureSequenceWriter {
 public:
  /// \throws InputError when the file cannot be made.
  /// \param truth  goes into a file of version 2
  FeatureSequenceWriter(const std::filesystem::path& path, const FeatureFileInfo& info,
                        const FeatureTruth& truth = {});
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
  /// Share of the last frame's left image that movers cover, 0..1; 0 in files of version 1.
  [[nodiscard]] float mover_share() const;
  /// The truth about objects and landmarks; empty in files of version 1. Reads it anew.
  /// \throws InputError when it is damaged.
  [[nodiscard]] FeatureTruth truth() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Whether the file begins as a feature file does.
bool is_feature_file(const std::filesystem::path& path);

}  // namespace kys_slam
