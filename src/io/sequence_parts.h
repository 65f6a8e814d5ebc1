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

/// Pairs left and right images by the numbers in their names; every image must have its partner in
/// the other camera. Time stamps are 0.
std::vector<Sequence::Frame> pair_by_name(const std::filesystem::path& left,
                                          const std::filesystem::path& right);

/// Pairs the images of two cameras by time, in order: each takes the nearest one that is at most
/// `tolerance` (s) away. Images without a partner are left out, so that a lost image does not shift
/// those after it.
/// \param left, right time stamps (ns), increasing
/// \returns positions in `left` and in `right`
std::vector<std::pair<std::size_t, std::size_t>> pair_stamps(std::span<const std::int64_t> left,
                                                             std::span<const std::int64_t> right,
                                                             double tolerance);

/// Sets the time stamps: the first number of every line, in the order of the frames.
/// \throws InputError when their numbers differ or time stamps do not increase
void read_times(const std::filesystem::path& file, std::vector<Sequence::Frame>& frames);

/// For layouts whose frames have no times but a rate. Names without a number are not looked at.
/// \throws InputError naming the image after a gap in the numbers that names end in
void require_consecutive(const std::vector<Sequence::Frame>& frames);

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
