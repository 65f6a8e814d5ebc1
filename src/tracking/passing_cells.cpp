// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/passing_cells.h"

#include <kys/portable_math.h>

#include <algorithm>
#include <utility>

#include "tracking/open_cells.h"

namespace kys_slam {
namespace {

constexpr double kStanding = 0.9;  // share of the inliers that keep their place
constexpr double kFlow = 4;        // shift of what flows by, times that of what keeps its place
constexpr double kAgree = 0.15;    // of a shift, by which neighbours may differ
constexpr int kAgreeing = 3;       // features of a cell that agree in their shift

/// A feature of the last frame that was found again.
struct Shift {
  float u = 0, v = 0;     // px, where it was
  double du = 0, dv = 0;  // px
  double scale = 1;       // of its octave

  [[nodiscard]] double length() const { return kys::portable::hypot(du, dv); }
};

/// Whether the pose leaves the inliers where they are in the image.
bool stands(const TrackingContext& c, const TrackedFrame& frame) {
  const FrameFeatures& features = *frame.features;
  const Rigid3 T_last_c = c.last->T_c_w * frame.T_c_w.inverse();
  int inliers = 0, still = 0;
  for (std::size_t i = 0; i < features.size(); ++i) {
    if (!frame.landmarks[i].valid() || !features.has_stereo(i)) continue;
    const Keypoint& k = features.keypoint(i);
    const Eigen::Vector3d p = T_last_c * c.camera.back_project(k.x, k.y, features.depth(i));
    ++inliers;
    if (!(p.z() > 0)) continue;
    const Eigen::Vector2d before = c.camera.project(p);
    const double shift = kys::portable::hypot(before.x() - k.x, before.y() - k.y);
    still += shift <= c.options.integrity.still ? 1 : 0;
  }
  return inliers > 0 && still >= kStanding * inliers;
}

std::vector<Shift> find_shifts(const TrackingContext& c, const TrackedFrame& frame,
                               const ImageCells& cells, const CellCounts& counts,
                               kys::Statistics& statistics) {
  const FrameFeatures& before = *c.last->features;
  std::vector<std::size_t> numbers;
  for (std::size_t i = 0; i < before.size(); ++i) {
    const Keypoint& k = before.keypoint(i);
    if (counts.is_unexplained(cells.index(k.x, k.y)) && c.beliefs.is_static(before.prior(i))) {
      numbers.push_back(i);
    }
  }
  const auto limit = static_cast<std::size_t>(c.options.integrity.points);
  numbers = choose_evenly(std::move(numbers), limit);
  const std::vector<std::int32_t> found = find_again(c, frame, numbers, statistics);
  std::vector<Shift> shifts;
  for (std::size_t q = 0; q < numbers.size(); ++q) {
    if (found[q] < 0) continue;
    const Keypoint& a = before.keypoint(numbers[q]);
    const Keypoint& b = frame.features->keypoint(static_cast<std::size_t>(found[q]));
    shifts.push_back({a.x, a.y, b.x - a.x, b.y - a.y, c.scales.scale[a.octave]});
  }
  return shifts;
}

bool agree(const Shift& a, const Shift& b, double still) {
  const double bound =
      std::max(2 * still * std::max(a.scale, b.scale), kAgree * std::min(a.length(), b.length()));
  return kys::portable::hypot(a.du - b.du, a.dv - b.dv) <= bound;
}

/// Whether several shifts agree and fewer features keep their place.
bool flows_by(const std::vector<Shift>& shifts, double still) {
  std::ptrdiff_t staying = 0, most = 0;
  for (const Shift& s : shifts) {
    if (s.length() <= 2 * still * s.scale) ++staying;
    if (s.length() <= kFlow * still * s.scale) continue;
    most = std::max(most, std::ranges::count_if(
                              shifts, [&](const Shift& other) { return agree(s, other, still); }));
  }
  return most >= kAgreeing && most > staying;
}

bool lie_in_front(const TrackedFrame& frame, const ImageCells& cells,
                  const std::vector<std::size_t>& passing) {
  std::vector<std::size_t> there;
  for (std::size_t i = 0; i < frame.features->size(); ++i) {
    const Keypoint& k = frame.features->keypoint(i);
    if (frame.features->has_stereo(i) &&
        std::ranges::binary_search(passing, cells.index(k.x, k.y))) {
      there.push_back(i);
    }
  }
  const DepthOrder order = compare_depths(frame, cells, there, passing);
  return order.in_front > order.behind;
}

}  // namespace

std::vector<std::size_t> find_passing_cells(const TrackingContext& c, const TrackedFrame& frame,
                                            const std::vector<std::uint8_t>& ignored,
                                            kys::Statistics& statistics) {
  if (!stands(c, frame)) return {};
  const ImageCells cells(c.camera, kAreaColumns);
  const CellCounts counts = count_cells(c, frame, cells, ignored);
  std::vector<std::vector<Shift>> shifts(cells.size());
  for (const Shift& s : find_shifts(c, frame, cells, counts, statistics)) {
    shifts[cells.index(s.u, s.v)].push_back(s);
  }
  std::vector<std::size_t> passing;
  for (std::size_t cell = 0; cell < cells.size(); ++cell) {
    if (flows_by(shifts[cell], c.options.integrity.still)) passing.push_back(cell);
  }
  if (lie_in_front(frame, cells, passing)) passing.clear();
  return passing;
}

}  // namespace kys_slam
