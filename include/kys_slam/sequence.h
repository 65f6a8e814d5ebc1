// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/frame_source.h>
#include <kys_slam/stereo_rectifier.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace kys_slam {

/// The stereo pair to use of a sequence with two pairs (KITTI odometry). The left cameras of the
/// pairs are 6 cm apart: perception outputs of one pair do not fit the other.
enum class CameraPair : std::uint8_t {
  kFirst,   ///< grey, else colour
  kGrey,    ///< image_0, image_1
  kColour,  ///< image_2, image_3
};
/// "" (first), "grey" or "colour". \throws InputError for anything else.
CameraPair parse_camera_pair(const std::string& name);

/// Which part of a sequence to use.
struct SequenceOptions {
  std::int64_t start = 0;              ///< first frame, from 0
  std::optional<std::int64_t> frames;  ///< number of frames; not given: to the end
  double pairing_tolerance = 0.003;    ///< s, EuRoC: largest difference of the two cameras' stamps
  CameraPair pair = CameraPair::kFirst;
};
/// For check_options().
void describe(kys::OptionList& list, SequenceOptions& options);

/// A recorded stereo sequence in a folder. Frames are read in order (`next`) or by position; `read`
/// may be called from several threads. Positions run from 0 to frame_count()-1 of the selected
/// part. StereoFrame::index counts from the beginning of the whole sequence.
class Sequence : public FrameSource {
 public:
  /// Files of one frame.
  struct Frame {
    std::string name;      ///< stem of the left image's file name
    double timestamp = 0;  ///< s, strictly increasing
    std::filesystem::path left;
    std::filesystem::path right;
  };

  /// Everything about a sequence except its pixels. The reader of each layout fills it in.
  struct Content {
    std::string name;
    std::string layout;  ///< "KITTI odometry", "KITTI Tracking", "Virtual KITTI 2", "EuRoC", ...
    StereoCamera camera;
    std::vector<Frame> frames;
    std::vector<TimedPose> ground_truth;               ///< left camera frame
    std::optional<Rigid3> T_b_c;                       ///< rectified left camera to body
    std::shared_ptr<const StereoRectifier> rectifier;  ///< null: images are rectified already
    std::int64_t dropped = 0;        ///< images without a partner in the other camera
    std::int64_t missing = 0;        ///< images that a list of images has, and no file
    bool paired_by_time = false;     ///< false: by number, without a tolerance
    int bits = 16;                   ///< that 16-bit images use
    std::vector<std::string> notes;  ///< warnings about how the images are read
  };

  /// \param first_index  index of content.frames[0] in the whole sequence
  Sequence(Content content, std::int64_t first_index);
  ~Sequence() override;

  /// Short name for output folders, e.g. "06", "0001", "Scene01-clone", "V1_01_easy".
  [[nodiscard]] const std::string& name() const { return content_.name; }
  [[nodiscard]] const std::string& layout() const { return content_.layout; }
  [[nodiscard]] const StereoCamera& camera() const override { return content_.camera; }
  [[nodiscard]] std::optional<std::int64_t> size() const override { return frame_count(); }
  [[nodiscard]] std::int64_t frame_count() const {
    return static_cast<std::int64_t>(content_.frames.size());
  }
  /// Name, time stamp and files of a frame; decodes nothing.
  [[nodiscard]] const Frame& frame(std::int64_t position) const {
    return content_.frames.at(static_cast<std::size_t>(position));
  }
  /// The same of a StereoFrame of this sequence, by its index; null: it is of another part.
  [[nodiscard]] const Frame* find(std::int64_t index) const {
    const std::int64_t position = index - first_index_;
    return position >= 0 && position < frame_count() ? &frame(position) : nullptr;
  }
  /// What images in the files go through; null: they are rectified.
  [[nodiscard]] const StereoRectifier* rectifier() const { return content_.rectifier.get(); }
  /// Poses of the (rectified) left camera; empty when the sequence has none. KITTI layouts: one
  /// per frame. EuRoC: the recorder's own stamps, the whole recording.
  [[nodiscard]] const std::vector<TimedPose>& ground_truth() const { return content_.ground_truth; }
  /// Rectified left camera to body (EuRoC), for results in the body frame.
  [[nodiscard]] const std::optional<Rigid3>& T_b_c() const { return content_.T_b_c; }
  /// Number of images left out because the other camera has no image of that time.
  [[nodiscard]] std::int64_t dropped() const { return content_.dropped; }
  /// Warnings for the user about how the images are read.
  [[nodiscard]] const std::vector<std::string>& notes() const { return content_.notes; }
  /// Number of images that are listed (EuRoC's data.csv), but not there.
  [[nodiscard]] std::int64_t missing() const { return content_.missing; }
  /// Whether images are pairs by their time stamps (SequenceOptions::pairing_tolerance).
  [[nodiscard]] bool paired_by_time() const { return content_.paired_by_time; }

  /// The rectified grey pair at a position. Thread-safe.
  /// \throws InputError naming the file: missing, truncated, corrupt, of another size.
  [[nodiscard]] StereoFrame read(std::int64_t position) const;

  std::optional<StereoFrame> next() override;

 private:
  Content content_;
  std::int64_t first_index_ = 0;
  std::int64_t position_ = 0;
};

/// Opens a sequence in one of the KITTI layouts. The content of the folder decides which:
/// - KITTI odometry: image_0/ and image_1/ (else image_2/ and image_3/; options.pair), calib.txt,
///   times.txt; ground truth in poses.txt, else in ../../poses/NAME.txt
/// - KITTI Tracking: the folder is ROOT/image_02/0001, its right images in ROOT/image_03/0001,
///   ROOT/calib/0001.txt, ground truth from ROOT/oxts/0001.txt; 10 Hz
/// - Virtual KITTI 2: Scene01/clone with frames/rgb/Camera_{0,1}, intrinsic.txt, extrinsic.txt;
///   10 Hz
///
/// Images are pairs by the numbers in their names; those without a partner are left out and
/// counted. Files with a row per image may have rows of the whole recording, from number 0 on.
/// times.txt: one time stamp per line, first column, or the second one behind a counter; s, else
/// ms, us or ns. \throws InputError naming the file and what is wrong with it.
std::unique_ptr<Sequence> open_kitti_sequence(const std::filesystem::path& folder,
                                              const SequenceOptions& options = {});

/// Opens an EuRoC or TUM-VI sequence: the folder that holds mav0/, or mav0/ itself. TUM-VI has
/// dso/camchain.yaml in place of sensor.yaml files. Images are rectified and paired by time stamp;
/// images without a partner, or without a file, are left out and counted. Ground truth is converted
/// from the body to the rectified left camera. \throws InputError naming the file and what is wrong
/// with it.
std::unique_ptr<Sequence> open_euroc_sequence(const std::filesystem::path& folder,
                                              const SequenceOptions& options = {});

/// True when the folder has the EuRoC layout, by the names of its sub-folders.
bool is_euroc_folder(const std::filesystem::path& folder);

/// Opens a sequence folder of any layout above.
/// \throws InputError as those functions do.
std::unique_ptr<Sequence> open_sequence(const std::filesystem::path& folder,
                                        const SequenceOptions& options = {});

/// Camera calibration in the ASL format (EuRoC's sensor.yaml): T_BS (4x4, camera to body),
/// resolution, intrinsics, distortion of any lens that read_stereo_rig knows.
/// \throws InputError naming the file and the key that is missing, malformed or not finite.
RawCamera read_sensor_yaml(const std::filesystem::path& path);

/// Rectified left camera to body of an EuRoC sequence, from its calibration alone.
Rigid3 read_euroc_T_b_c(const std::filesystem::path& folder);

}  // namespace kys_slam
