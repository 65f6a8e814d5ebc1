// SPDX-License-Identifier: BSD-3-Clause
#include <kys/label_space.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/prior_writer.h>
#include <kys_slam/util/memory_limit.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdlib>

namespace kys_slam {
namespace {

namespace pf = prior_format;
using Bytes = std::vector<std::uint8_t>;

void put(Bytes& out, std::uint64_t value, int size) {
  for (int i = 0; i < size; ++i) out.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

void put_at(Bytes& out, std::size_t at, std::uint64_t value, int size) {
  for (int i = 0; i < size; ++i) {
    out[at + static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(value >> (8 * i));
  }
}

void put_varint(Bytes& out, std::uint32_t value) {
  for (; value >= 0x80; value >>= 7) out.push_back(static_cast<std::uint8_t>(value | 0x80));
  out.push_back(static_cast<std::uint8_t>(value));
}

/// Motion codes of all values by a table over mu in steps of 1/32, refined by comparison: the
/// logarithm is not taken per pixel.
class MotionCoder {
 public:
  explicit MotionCoder(const MotionCoding& coding) {
    const auto& values = pf::motion_of_code();
    for (std::size_t q = 0; q < 256; ++q) {
      side_[q] = side_of(values[q], coding.keep_sides);
    }
    // upper_[q]: the largest mu that gets code q. Between two codes of one side the border is half
    // way in ln(1 + mu); between two sides it is the kept value itself.
    for (std::size_t q = 0; q < 255; ++q) {
      upper_[q] = static_cast<float>(std::sqrt((1.0 + values[q]) * (1.0 + values[q + 1])) - 1.0);
      for (const float kept : coding.keep_sides) {
        if (values[q] <= kept && values[q + 1] > kept) upper_[q] = kept;
      }
    }
    upper_[255] = 100.0F;
    for (int run = 0; run < 256; ++run) {
      ranges_[static_cast<std::size_t>(run)] = make_range(run, coding.tolerance_steps);
    }
    std::size_t q = 0;
    for (std::size_t i = 0; i < start_.size(); ++i) {
      while (q < 255 && static_cast<float>(i) / 32.0F > upper_[q]) ++q;
      start_[i] = static_cast<std::uint8_t>(q);
    }
  }

  [[nodiscard]] std::uint8_t code(float mu) const {
    std::size_t q = start_[static_cast<std::size_t>(mu * 32.0F)];
    while (q < 255 && mu > upper_[q]) ++q;
    return static_cast<std::uint8_t>(q);
  }
  /// Values that go on a run of this code: codes within the tolerance, on the same side of the
  /// kept values.
  struct Range {
    float least = 0, most = -1;
    [[nodiscard]] bool contains(float mu) const { return mu >= least && mu <= most; }
  };
  [[nodiscard]] Range range_of(std::uint8_t code) const { return ranges_[code]; }

 private:
  static int side_of(float mu, const std::vector<float>& kept) {
    return static_cast<int>(
        std::count_if(kept.begin(), kept.end(), [mu](float k) { return mu > k; }));
  }
  [[nodiscard]] Range make_range(int run, int tolerance) const {
    const auto same = [&](int q) {
      return q >= 0 && q < 256 && std::abs(q - run) <= tolerance &&
             side_[static_cast<std::size_t>(q)] == side_[static_cast<std::size_t>(run)];
    };
    int first = run, last = run;
    while (same(first - 1)) --first;
    while (same(last + 1)) ++last;
    Range range;
    if (first > 0)
      range.least = std::nextafter(upper_[static_cast<std::size_t>(first - 1)], 200.0F);
    range.most = upper_[static_cast<std::size_t>(last)];
    return range;
  }

  std::array<int, 256> side_{};
  std::array<float, 256> upper_{};
  std::array<Range, 256> ranges_{};
  std::array<std::uint8_t, 3201> start_{};
};

[[noreturn]] void fail(const std::string& name, const std::string& what) {
  throw InputError(name + ": " + what);
}

void check_segments(const CameraPriors& camera, std::size_t index, const std::string& name) {
  if (camera.segments.size() > pf::kMaxSegments) fail(name, "more than 65535 segments");
  for (const PriorSegment& s : camera.segments) {
    const bool right = index == 1;
    if (s.label == kys::kVoidLabel || (s.flags & ~pf::kKnownSegmentFlags) != 0 ||
        ((s.flags & pf::kRadialOnly) && !(s.flags & pf::kDynamic)) || s.instance < 0 ||
        (s.instance >= pf::kRightInstances) != right || !std::isfinite(s.scale) || s.scale < 0 ||
        !std::isfinite(s.score) || s.score < 0 || s.score > 100) {
      fail(name, "a segment cannot be encoded (label, flags, instance, scale or score)");
    }
  }
}

// Not inlined: it stays in registers, and most of the pixels pass here.
[[gnu::noinline]] const float* first_outside(MotionCoder::Range range, const float* mu,
                                             const float* end) {
  while (mu != end && range.contains(*mu)) ++mu;
  return mu;
}

/// One row: its segment runs, then the motion runs over its dynamic pixels.
class RowEncoder {
 public:
  RowEncoder(const CameraPriors& camera, const MotionCoder& coder, const std::string& name)
      : camera_(camera), coder_(coder), name_(name), area_(camera.segments.size() + 1, 0) {}

  void encode(int y, std::span<const SegmentRun> runs, Bytes& out) {
    const float* motion = camera_.motion.empty() ? nullptr : camera_.motion.row(y);
    motion_runs_.clear();
    const int width = camera_.segment_map.width();
    int x = 0;
    for (const SegmentRun& run : runs) {
      if (run.segment >= area_.size()) {
        fail(name_, "the map has a segment that is not in the table");
      }
      if (run.x0 != x || run.x1 <= x || run.x1 > width) {
        fail(name_, "the runs are not those of a map");
      }
      x = run.x1;
      put_varint(out, static_cast<std::uint32_t>(run.x1 - run.x0));
      put_varint(out, run.segment);
      area_[run.segment] += static_cast<std::uint32_t>(run.x1 - run.x0);
      if (run.segment > 0 && (camera_.segments[run.segment - 1u].flags & pf::kDynamic)) {
        if (motion == nullptr) fail(name_, "a dynamic segment has no motion image");
        add_motion(motion + run.x0, motion + run.x1);
      }
    }
    if (x != width) fail(name_, "the runs are not those of a map");
    flush_motion();
    out.insert(out.end(), motion_runs_.begin(), motion_runs_.end());
  }

  [[nodiscard]] std::uint32_t area(std::size_t segment) const { return area_[segment]; }

 private:
  void add_motion(const float* mu, const float* end) {
    while (mu != end) {
      const float* next = first_outside(range_, mu, end);
      length_ += static_cast<std::uint32_t>(next - mu);
      mu = next;
      if (mu == end) break;
      if (!(*mu >= 0.0F && *mu <= 100.0F)) fail(name_, "a motion value is not in 0..100");
      flush_motion();
      run_ = coder_.code(*mu);
      range_ = coder_.range_of(run_);
    }
  }
  void flush_motion() {
    if (length_ == 0) return;
    put_varint(motion_runs_, length_);
    motion_runs_.push_back(run_);
    length_ = 0;
    range_ = {};
  }

  const CameraPriors& camera_;
  const MotionCoder& coder_;
  const std::string& name_;
  std::vector<std::uint32_t> area_;
  Bytes motion_runs_;
  std::uint32_t length_ = 0;
  std::uint8_t run_ = 0;
  MotionCoder::Range range_;
};

void encode_camera(const CameraPriors& camera, std::size_t index, const MotionCoder& coder,
                   const std::string& name, Bytes& out) {
  check_segments(camera, index, name);
  const int height = camera.segment_map.height();
  const SegmentRuns found = camera.runs.empty() ? find_runs(camera.segment_map) : SegmentRuns();
  const SegmentRuns& segment_runs = camera.runs.empty() ? found : camera.runs;
  if (segment_runs.rows() != height) fail(name, "the runs are not those of a map");
  Bytes runs, row_index;
  RowEncoder encoder(camera, coder, name);
  for (int y = 0; y < height; ++y) {
    put(row_index, runs.size(), 4);
    encoder.encode(y, segment_runs.row(y), runs);
  }
  put(row_index, runs.size(), 4);

  const std::size_t entry = pf::kHeaderSize + index * pf::kCameraEntrySize;
  put_at(out, entry, out.size(), 4);
  put_at(out, entry + 4, camera.segments.size(), 4);
  for (std::size_t k = 0; k < camera.segments.size(); ++k) {
    const PriorSegment& s = camera.segments[k];
    put(out, s.label, 2);
    put(out, s.flags, 2);
    put(out, static_cast<std::uint32_t>(s.instance), 4);
    put(out, std::bit_cast<std::uint32_t>(s.scale), 4);
    put(out, std::bit_cast<std::uint32_t>(s.score), 4);
    put(out, encoder.area(k + 1), 4);
  }
  put_at(out, entry + 8, out.size(), 4);
  out.insert(out.end(), row_index.begin(), row_index.end());
  put_at(out, entry + 12, out.size(), 4);
  put_at(out, entry + 16, runs.size(), 4);
  out.insert(out.end(), runs.begin(), runs.end());
}

}  // namespace

std::uint8_t motion_code(float mu, const MotionCoding& coding) {
  return MotionCoder(coding).code(std::clamp(mu, 0.0F, 100.0F));
}

std::vector<std::uint8_t> encode_priors(const FramePriors& priors, const std::string& name,
                                        const MotionCoding& coding) {
  if (priors.cameras.empty() || priors.cameras.size() > pf::kMaxCameras) {
    fail(name, "priors need one or two cameras");
  }
  const int width = priors.cameras[0].segment_map.width();
  const int height = priors.cameras[0].segment_map.height();
  if (width < 1 || height < 1 || width > pf::kMaxSide || height > pf::kMaxSide) {
    fail(name, "image size is not within 1..16384");
  }
  if (!kys::is_label_space_name(priors.label_space, pf::kLabelSpaceLength)) {
    fail(name, "label space name needs 1 to 32 characters from ! to ~");
  }
  for (const CameraPriors& c : priors.cameras) {
    const bool motion_fits =
        c.motion.empty() || (c.motion.width() == width && c.motion.height() == height);
    if (c.segment_map.width() != width || c.segment_map.height() != height || !motion_fits) {
      fail(name, "the cameras' images differ in size");
    }
  }

  Bytes out(pf::kHeaderSize + priors.cameras.size() * pf::kCameraEntrySize, 0);
  std::copy(pf::kMagic.begin(), pf::kMagic.end(), out.begin());
  put_at(out, pf::kAtVersion, pf::kVersion, 2);
  put_at(out, pf::kAtHeaderSize, pf::kHeaderSize, 2);
  put_at(out, pf::kAtWidth, static_cast<std::uint64_t>(width), 2);
  put_at(out, pf::kAtHeight, static_cast<std::uint64_t>(height), 2);
  put_at(out, pf::kAtCameras, priors.cameras.size(), 2);
  const int flags = (priors.has_motion ? pf::kFrameHasMotion : 0) |
                    (priors.shares_instances ? pf::kFrameSharesInstances : 0);
  put_at(out, pf::kAtFrameFlags, static_cast<std::uint64_t>(flags), 2);
  put_at(out, pf::kAtCalibration, priors.calibration_hash, 8);
  put_at(out, pf::kAtContentKey, priors.content_key, 8);
  std::copy(priors.label_space.begin(), priors.label_space.end(), out.begin() + pf::kAtLabelSpace);
  const MotionCoder coder(coding);
  for (std::size_t i = 0; i < priors.cameras.size(); ++i) {
    encode_camera(priors.cameras[i], i, coder, name, out);
  }
  if (out.size() > pf::kMaxFileSize) fail(name, "priors are too large for a file");
  put_at(out, pf::kAtFileSize, out.size(), 4);
  put_at(out, pf::kAtChecksum, pf::crc32(out.data() + pf::kAtChecked, out.size() - pf::kAtChecked),
         4);
  return out;
}

FramePriors decode_priors(const PriorFile& file) {
  FramePriors priors;
  priors.label_space = file.label_space();
  priors.calibration_hash = file.calibration_hash();
  priors.content_key = file.content_key();
  priors.has_motion = file.has_motion();
  priors.shares_instances = file.shares_instances();
  const auto width = static_cast<std::size_t>(file.width());
  constexpr std::size_t kBytesPerPixel = sizeof(std::uint16_t) + sizeof(float);
  check_memory("a prior file's images",
               kBytesPerPixel * width * static_cast<std::size_t>(file.height()));
  for (std::size_t i = 0; i < file.camera_count(); ++i) {
    const auto side = static_cast<CameraSide>(i);
    CameraPriors& camera = priors.cameras.emplace_back();
    camera.segments = file.segments(side);
    camera.segment_map = ImageOf<std::uint16_t>(file.width(), file.height());
    camera.motion = ImageOf<float>(file.width(), file.height());
    for (int y = 0; y < file.height(); ++y) {
      file.expand_row(side, y, {camera.segment_map.row(y), width}, {camera.motion.row(y), width});
    }
  }
  return priors;
}

}  // namespace kys_slam
