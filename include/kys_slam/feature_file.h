// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance.h>
#include <kys_slam/frame_source.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

/// Feature files: stereo frames as features instead of images, with the camera and the true poses.
/// The format is described byte by byte in tools/simulator/features/README.md.
namespace kys_slam {

/// Header of a feature file.
struct FeatureFileInfo {
  StereoCamera camera;
  double scale_factor = 1.2;  ///< between two octaves
  int levels = 8;             ///< octaves
  std::uint64_t seed = 0;
  std::vector<TimedPose> poses;  ///< true pose of the left camera, one per frame
  int version = 1;               ///< of the format: 2 carries priors and the truth about objects
  std::string label_space = {};  ///< of the priors; "": the frames have none
};

/// How a descriptor was generated: the bits of a base descriptor, some of them flipped. A file that
/// stores this need not store all 256 bits.
struct DescriptorOrigin {
  enum class Kind : std::uint8_t {
    kRaw,     ///< not known: all bits are stored
    kOwn,     ///< the base descriptor of the landmark
    kFamily,  ///< a base descriptor that several landmarks share; `value` is its number, below
              ///< 65536
    kState,   ///< `value` is the state of a random generator
  };
  Kind kind = Kind::kRaw;
  std::uint64_t value = 0;
};

/// The 256 bits generated from the state of a random generator.
kys::Descriptor expand_descriptor(std::uint64_t key);

/// The base descriptor of a feature, before any bit flips; zero for kRaw.
kys::Descriptor base_descriptor(const DescriptorOrigin& origin, std::int32_t landmark,
                                std::uint64_t seed);

/// The features of one frame, and the landmark that each one observes (-1: none, an outlier).
struct FeatureFrame {
  FeatureSet left, right;
  std::vector<std::int32_t> left_landmarks, right_landmarks;
  // The members below are in files of version 2 only.
  std::vector<DescriptorOrigin> left_origins, right_origins;  ///< empty: all kRaw
  bool has_priors = false;
  /// one per feature; motion quantised to 256 codes
  std::vector<kys::Prior> left_priors, right_priors;
  float mover_share = 0;  ///< of the left image's area, 0..1
};

/// A solid box of the simulated world, with its poses.
struct FeatureObject {
  enum class Kind : std::uint16_t {
    kStatic,       ///< never moves; one pose
    kRigid,        ///< one pose per frame
    kArticulated,  ///< as kRigid, and its landmarks oscillate about their positions
  };
  std::uint16_t label = 0;  ///< in the label space of the file
  Kind kind = Kind::kStatic;
  Eigen::Vector3f half_size = Eigen::Vector3f::Ones();  ///< m, along its own axes
  std::int64_t first_frame = 0;
  std::vector<Rigid3> poses;  ///< T_w_o of the frames from first_frame on; o: the box's centre
};

/// Ground truth of the world. The index in a list is the id.
struct FeatureTruth {
  struct Landmark {
    Eigen::Vector3f position = Eigen::Vector3f::Zero();  ///< m, in the world or in its object
    std::int32_t object = -1;                            ///< -1: of the static scene
    std::uint16_t label = 0xFFFF;                        ///< kys::kVoidLabel: of no class
  };
  std::vector<FeatureObject> objects;
  std::vector<Landmark> landmarks;
};

/// Writes a feature file frame by frame. `finish` renames the temporary file to `path`.
class FeatureSequenceWriter {
 public:
  /// \param truth  written to files of version 2 only
  /// \throws InputError when the file cannot be created.
  FeatureSequenceWriter(const std::filesystem::path& path, const FeatureFileInfo& info,
                        const FeatureTruth& truth = {});
  ~FeatureSequenceWriter();  ///< without finish(): removes the temporary file
  FeatureSequenceWriter(const FeatureSequenceWriter&) = delete;
  FeatureSequenceWriter& operator=(const FeatureSequenceWriter&) = delete;

  /// Pixel positions are stored in steps of 1/32 px, within [0, 2047] px.
  void write(const FeatureFrame& frame);
  /// \throws InputError when the disk is full, or when the file cannot be renamed and stays under
  /// its temporary name; std::logic_error when frames of the header are missing.
  void finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Reads a feature file. Every block carries a checksum. Of a truncated or corrupt file, the read
/// of the damaged frame throws InputError naming the file; so does the read of a frame with more
/// than 65535 features in an image, or with priors whose labels are not in their label space.
class FeatureSequence : public FrameSource {
 public:
  /// Frames [start, start + frames) of the file; frames < 0: to the end. Frame indices and names
  /// ("000123") count from the first frame of the file.
  explicit FeatureSequence(const std::filesystem::path& path, std::int64_t start = 0,
                           std::int64_t frames = -1);
  ~FeatureSequence() override;

  [[nodiscard]] const StereoCamera& camera() const override;
  [[nodiscard]] std::optional<std::int64_t> size() const override;
  std::optional<StereoFrame> next() override;

  [[nodiscard]] const FeatureFileInfo& info() const;
  /// True poses T_w_c of all frames of this sequence, those not read yet included.
  [[nodiscard]] const std::vector<TimedPose>& ground_truth() const;
  /// Landmark ids of the features of the last next(), index by index; -1: an outlier.
  [[nodiscard]] const std::vector<std::int32_t>& left_landmarks() const;
  [[nodiscard]] const std::vector<std::int32_t>& right_landmarks() const;
  /// Share of the last left image covered by objects that can move, 0..1; 0 in files of version 1.
  [[nodiscard]] float mover_share() const;
  /// Ground truth of objects and landmarks; empty in files of version 1. Every call reads it from
  /// the file. \throws InputError when it is damaged.
  [[nodiscard]] FeatureTruth truth() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// True when the file begins with the magic bytes of a feature file.
bool is_feature_file(const std::filesystem::path& path);

}  // namespace kys_slam
