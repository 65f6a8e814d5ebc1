// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>
#include <kys_slam/rig_rows.h>
#include <kys_slam/stereo_camera.h>

#include <array>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace kys_slam {

/// What rows say about a pair.
enum class RowVerdict : std::uint8_t {
  kUnknown,      ///< too few matches to tell
  kRectified,    ///< rows agree
  kUnrectified,  ///< they do not
};

/// Differences of rows between the images of a rectified pair, v of the right image less v of the
/// left one, over the left image: what a given correction leaves of them. They are zero when the
/// calibration is right.
struct RowField {
  static constexpr std::size_t kColumns = 6, kRows = 4;  ///< of cells of equal size
  static constexpr std::size_t kLeastInCell = 8;         ///< matches; with fewer, it has no median
  static constexpr std::size_t kLeastMatches = 100;      ///< to tell anything
  static constexpr double kMinField = 0.1;               ///< px; default of calibration.min_field

  struct Cell {
    std::size_t matches = 0;
    double median = 0;        ///< px, NaN with fewer than kLeastInCell matches
    double median_after = 0;  ///< px, of what the fitted correction leaves; NaN likewise
  };

  std::size_t pairs = 0;
  std::size_t stereo_matches = 0;  ///< also those whose row is not measured
  std::vector<RowObservation> matches;
  std::array<std::array<Cell, kColumns>, kRows> cells;
  RowFit fit;  ///< of all matches, by fit_rows() from what the meter was given

  /// \param min_field px; a field (RowFit::field) above it is one that matters
  [[nodiscard]] RowVerdict verdict(double min_field = kMinField) const;
  /// The verdict in one line, with its figure.
  [[nodiscard]] std::string describe(double min_field = kMinField) const;
  /// px, largest absolute median of the cells; 0 when no cell has one
  [[nodiscard]] double largest() const;
  [[nodiscard]] double largest_after() const;
};

/// Measures the rows of stereo matches in pairs of one camera, as a run with default settings does:
/// extraction, stereo matching, alignment of patches. The pairs may show anything with texture,
/// also without motion; together they should fill the image.
class RowMeter {
 public:
  /// \param known a correction of the calibration that is applied (`kys-slam calibrate`), and what
  /// it is worth
  explicit RowMeter(const StereoCamera& camera,
                    const RigEstimate& known = {RigCorrection(), rig_prior()});
  RowMeter(RowMeter&&) noexcept;
  RowMeter& operator=(RowMeter&&) noexcept;
  ~RowMeter();

  /// Adds the matches of a pair. Takes about 100 ms.
  /// \throws InputError when an image does not have the size of the camera
  void add(const GrayImage& left, const GrayImage& right);

  /// Of all pairs so far.
  [[nodiscard]] RowField field() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace kys_slam
