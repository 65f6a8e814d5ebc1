// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/sequence.h>

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <utility>
#include <vector>

/// Functions shared by the readers of the sequence layouts. All throw InputError naming the file.
namespace kys_slam {

/// Of KITTI Tracking and Virtual KITTI 2, which have no time stamps.
inline constexpr double kFrameRate = 10.0;  // Hz

/// The folder as given, without a trailing slash, made absolute.
/// \throws InputError when it is no folder.
std::filesystem::path sequence_folder(const std::filesystem::path& folder);

/// PNG and JPEG files of a folder, sorted by name, numbers in names by value (2 before 10). Throws
/// when there are none, and for two files of one frame (3.png and 003.png, 3.png and 3.jpg).
std::vector<std::filesystem::path> list_images(const std::filesystem::path& folder);

/// Images of two folders as pairs of the same numbers in their names. Time stamps are 0.
struct NamedPairs {
  std::vector<Sequence::Frame> frames;
  std::int64_t dropped = 0;            ///< images without a partner
  std::vector<std::int64_t> numbers;   ///< of the frames, increasing; empty: names have none
  std::vector<std::size_t> positions;  ///< of the frames among the left images
  std::size_t left_images = 0;

  /// Which row of a file with one row per image belongs to a frame: rows of all left images, or of
  /// the whole recording, whose numbers count from 0 or 1.
  /// \throws InputError "FILE: N WHAT, but there are M images" when it is neither
  [[nodiscard]] std::size_t row_of(std::size_t frame, std::size_t rows,
                                   const std::filesystem::path& file, const char* what) const;
  /// Seconds of a frame after the first one at a constant rate, by the numbers if there are some.
  /// \param step  of the numbers from one frame to the next
  [[nodiscard]] double time_of(std::size_t frame, double rate, std::int64_t step = 1) const;
  /// The distance of most numbers; 1 without numbers.
  [[nodiscard]] std::int64_t step() const;
};
/// Images without a partner are left out and counted. \throws InputError when they are most of a
/// folder.
NamedPairs pair_by_name(const std::filesystem::path& left, const std::filesystem::path& right);

/// Pairs the images of two cameras by time, in order: each takes the nearest one that is at most
/// `tolerance` (s) away. Images without a partner are left out, so that a lost image does not shift
/// those after it.
/// \param left, right time stamps (ns), increasing
/// \returns positions in `left` and in `right`
std::vector<std::pair<std::size_t, std::size_t>> pair_stamps(std::span<const std::int64_t> left,
                                                             std::span<const std::int64_t> right,
                                                             double tolerance);

/// How many stamps (ns, increasing) there are and how near they come, for messages about images
/// that pair_stamps found no pair of.
std::string nearest_stamps(std::span<const std::int64_t> left, std::span<const std::int64_t> right);

/// Sets the time stamps to those of a text file (read_time_file).
/// \throws InputError when rows and frames differ in number
void read_times(const std::filesystem::path& file, NamedPairs& pairs);

/// Named matrices of a KITTI calibration file, e.g. 12 numbers of "P0" or "P0:". The first of
/// `names` that the file has counts.
/// \throws InputError when the file or the name is missing, the count is wrong, or there are two
/// different lines of the name.
std::vector<double> kitti_calibration_row(const std::filesystem::path& file,
                                          const std::vector<std::string>& names, std::size_t count);
Eigen::Matrix<double, 3, 4> kitti_projection(const std::filesystem::path& file,
                                             const std::string& name);

/// Sets the camera of a KITTI pair, its image size read from the first left image.
StereoCamera kitti_camera(const std::filesystem::path& calibration, const std::string& left,
                          const std::string& right, const std::filesystem::path& first_image);

/// Poses relative to the first one: T_w_c(i) <- T_w_c(0)^-1 T_w_c(i).
void make_relative_to_first(std::vector<TimedPose>& poses);

/// Selects the part given by `options`, of frames and of ground truth that has one pose per frame.
/// \throws InputError when the part is empty.
std::unique_ptr<Sequence> make_sequence(Sequence::Content content, const SequenceOptions& options,
                                        const std::filesystem::path& folder);

std::unique_ptr<Sequence> open_kitti_odometry(const std::filesystem::path& folder,
                                              const SequenceOptions& options);
std::unique_ptr<Sequence> open_kitti_tracking(const std::filesystem::path& folder,
                                              const SequenceOptions& options);
std::unique_ptr<Sequence> open_virtual_kitti(const std::filesystem::path& folder,
                                             const SequenceOptions& options);

}  // namespace kys_slam
