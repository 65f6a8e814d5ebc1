// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>
#include <kys/prior.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_file.h>
#include <kys_slam/prior_format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <numeric>
#include <stdexcept>

#include "priors/format/byte_io.h"

namespace kys_slam {
namespace {

namespace pf = prior_format;

[[noreturn]] void fail(const std::string& name, const std::string& what) {
  throw InputError(name + ": " + what);
}

void check(bool good, const std::string& name, const char* what) {
  if (!good) fail(name, what);
}

/// ln(1 + mu) of every motion code, as kys::make_prior() takes it.
const std::array<float, 256>& log_motion_of_code() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> values{};
    for (std::size_t q = 0; q < 256; ++q) {
      values[q] = kys::make_prior(0, 0, 0.0F, pf::motion_of_code()[q], true).log_motion;
    }
    return values;
  }();
  return table;
}

// Files are read, not mapped: at this size it costs the same, and a file that another program
// truncates while it is mapped would kill this one.
std::vector<std::uint8_t> read_whole(const std::filesystem::path& path) {
  struct Descriptor {
    int fd;
    ~Descriptor() {
      if (fd >= 0) ::close(fd);
    }
  };
  const std::string name = path.string();
  const Descriptor file{::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)};
  if (file.fd < 0) fail(name, std::string("cannot open: ") + std::strerror(errno));
  struct stat status {};
  if (::fstat(file.fd, &status) != 0) fail(name, std::strerror(errno));
  check(S_ISREG(status.st_mode), name, "is not a regular file");
  const auto size = static_cast<std::uint64_t>(status.st_size);
  check(size <= pf::kMaxFileSize, name, "is too large for a prior file");
  std::vector<std::uint8_t> bytes(size);
  std::size_t got = 0;
  while (got < bytes.size()) {
    const ssize_t n = ::read(file.fd, bytes.data() + got, bytes.size() - got);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) fail(name, std::string("cannot read: ") + std::strerror(errno));
    check(n != 0, name, "shrank while it was read");
    got += static_cast<std::size_t>(n);
  }
  return bytes;
}

PriorSegment load_segment(const std::uint8_t* p) {
  PriorSegment s;
  s.label = pf::load_u16(p);
  s.flags = pf::load_u16(p + 2);
  s.instance = static_cast<std::int32_t>(pf::load_u32(p + 4));
  s.scale = pf::load_f32(p + 8);
  s.score = pf::load_f32(p + 12);
  s.area = pf::load_u32(p + 16);
  return s;
}

void check_segment(const PriorSegment& s, std::size_t camera, const std::string& name,
                   std::size_t label_count) {
  check(s.label != kys::kVoidLabel, name, "a segment has the void label");
  if (label_count > 0 && s.label >= label_count) {
    fail(name, "label " + std::to_string(s.label) + " is not in the label space (" +
                   std::to_string(label_count) + " classes)");
  }
  check((s.flags & ~pf::kKnownSegmentFlags) == 0, name, "a segment has unknown flags");
  check(!(s.flags & pf::kRadialOnly) || (s.flags & pf::kDynamic), name,
        "a segment is radial-only but not dynamic");
  const bool right = camera == 1;
  check(s.instance >= 0 && (s.instance >= pf::kRightInstances) == right, name,
        "a segment's instance is not in its camera's range");
  check(std::isfinite(s.scale) && s.scale >= 0, name, "a segment's scale is not a number >= 0");
  check(std::isfinite(s.score) && s.score >= 0 && s.score <= 100, name,
        "a segment's score is not in 0..100");
}

}  // namespace

PriorFile PriorFile::open(const std::filesystem::path& path, const ExpectedPriors& expected) {
  return parse(read_whole(path), path.string(), expected);
}

PriorFile PriorFile::parse(std::vector<std::uint8_t> bytes, const std::string& name,
                           const ExpectedPriors& expected) {
  PriorFile file;
  file.bytes_ = std::move(bytes);
  file.parse_header(name, expected);
  const std::size_t count = pf::load_u16(file.bytes_.data() + pf::kAtCameras);
  check(count >= 1 && count <= pf::kMaxCameras, name, "camera count is not 1 or 2");
  file.cameras_.reserve(count);
  for (std::size_t i = 0; i < count; ++i) file.parse_camera(i, name, expected);
  return file;
}

void PriorFile::parse_header(const std::string& name, const ExpectedPriors& expected) {
  const std::uint8_t* h = bytes_.data();
  check(bytes_.size() >= pf::kMagic.size() && std::equal(pf::kMagic.begin(), pf::kMagic.end(), h),
        name, "is not a prior file (bad magic number)");
  check(bytes_.size() >= pf::kHeaderSize, name, "is truncated (no complete header)");
  if (pf::load_u16(h + pf::kAtVersion) != pf::kVersion) {
    fail(name, "has format version " + std::to_string(pf::load_u16(h + pf::kAtVersion)) +
                   ", this program reads version " + std::to_string(pf::kVersion));
  }
  check(pf::load_u16(h + pf::kAtHeaderSize) == pf::kHeaderSize, name, "header size is wrong");
  if (pf::load_u32(h + pf::kAtFileSize) != bytes_.size()) {
    fail(name, "is truncated or has been extended: " + std::to_string(bytes_.size()) +
                   " bytes, its header says " + std::to_string(pf::load_u32(h + pf::kAtFileSize)));
  }
  check(pf::load_u32(h + pf::kAtChecksum) ==
            pf::crc32(h + pf::kAtChecked, bytes_.size() - pf::kAtChecked),
        name, "is corrupt (checksum does not match)");
  width_ = pf::load_u16(h + pf::kAtWidth);
  height_ = pf::load_u16(h + pf::kAtHeight);
  check(width_ >= 1 && height_ >= 1 && width_ <= pf::kMaxSide && height_ <= pf::kMaxSide, name,
        "image size is not within 1..16384");
  const auto* label_begin = reinterpret_cast<const char*>(h + pf::kAtLabelSpace);
  const auto* label_end = std::find(label_begin, label_begin + pf::kLabelSpaceLength, '\0');
  label_space_.assign(label_begin, label_end);
  check(!label_space_.empty() &&
            std::all_of(label_begin, label_end, [](char c) { return c > 0x20 && c < 0x7F; }),
        name, "label space name is empty or not printable");
  const std::uint16_t flags = pf::load_u16(h + pf::kAtFrameFlags);
  check((flags & ~(pf::kFrameHasMotion | pf::kFrameSharesInstances)) == 0, name,
        "has unknown frame flags");
  has_motion_ = (flags & pf::kFrameHasMotion) != 0;
  shares_instances_ = (flags & pf::kFrameSharesInstances) != 0;
  calibration_hash_ = pf::load_u64(h + pf::kAtCalibration);
  content_key_ = pf::load_u64(h + pf::kAtContentKey);

  if ((expected.width > 0 && expected.width != width_) ||
      (expected.height > 0 && expected.height != height_)) {
    fail(name, "is for images of " + std::to_string(width_) + "x" + std::to_string(height_) +
                   ", the sequence has " + std::to_string(expected.width) + "x" +
                   std::to_string(expected.height));
  }
  check(expected.calibration_hash == 0 || calibration_hash_ == 0 ||
            expected.calibration_hash == calibration_hash_,
        name,
        "was made for another calibration than the sequence's, or for its other camera pair "
        "(--pair)");
  if (!expected.label_space.empty() && expected.label_space != label_space_) {
    fail(name, "uses label space " + label_space_ + ", configured is " + expected.label_space);
  }
}

void PriorFile::parse_camera(std::size_t index, const std::string& name,
                             const ExpectedPriors& expected) {
  const std::size_t entry = pf::kHeaderSize + index * pf::kCameraEntrySize;
  check(entry + pf::kCameraEntrySize <= bytes_.size(), name, "is truncated (camera table)");
  const std::uint8_t* e = bytes_.data() + entry;
  const std::size_t segments_at = pf::load_u32(e);
  const std::size_t segment_count = pf::load_u32(e + 4);
  CameraView camera;
  camera.row_index_at = pf::load_u32(e + 8);
  camera.runs_at = pf::load_u32(e + 12);
  camera.runs_size = pf::load_u32(e + 16);
  // All are below 2^32, sizes in bytes below 2^38: no overflow in 64 bits.
  const auto inside = [this](std::uint64_t at, std::uint64_t size) {
    return at >= pf::kHeaderSize && at + size <= bytes_.size();
  };
  check(segment_count <= pf::kMaxSegments, name, "has more than 65535 segments in one camera");
  check(inside(segments_at, std::uint64_t{segment_count} * pf::kSegmentSize), name,
        "segment table is outside the file");
  check(inside(camera.row_index_at, 4ull * (static_cast<std::uint64_t>(height_) + 1)), name,
        "row table is outside the file");
  check(inside(camera.runs_at, camera.runs_size), name, "runs are outside the file");

  camera.segments.reserve(segment_count);
  camera.priors.reserve(segment_count + 1);
  camera.priors.emplace_back();
  for (std::size_t k = 0; k < segment_count; ++k) {
    const PriorSegment s = load_segment(bytes_.data() + segments_at + k * pf::kSegmentSize);
    check_segment(s, index, name, expected.label_count);
    camera.segments.push_back(s);
    const std::int32_t instance = shares_instances_ ? s.instance % pf::kRightInstances : s.instance;
    const bool dynamic = (s.flags & pf::kDynamic) != 0;
    kys::Prior prior = kys::make_prior(s.label, instance, s.scale, 0.0F, dynamic);
    const bool unjudged = (s.flags & pf::kNotJudged) != 0 || (!has_motion_ && !dynamic);
    prior.unjudged = unjudged ? 1 : 0;
    camera.priors.push_back(prior);
  }
  check_runs(camera, name);
  cameras_.push_back(std::move(camera));
}

std::pair<const std::uint8_t*, const std::uint8_t*> PriorFile::row_bytes(const CameraView& camera,
                                                                         int y) const {
  const std::uint8_t* entry = bytes_.data() + camera.row_index_at + 4 * static_cast<std::size_t>(y);
  const std::uint8_t* runs = bytes_.data() + camera.runs_at;
  return {runs + pf::load_u32(entry), runs + pf::load_u32(entry + 4)};
}

void PriorFile::check_runs(const CameraView& camera, const std::string& name) const {
  const std::uint8_t* index = bytes_.data() + camera.row_index_at;
  check(pf::load_u32(index) == 0, name, "row table does not start at 0");
  check(pf::load_u32(index + 4 * static_cast<std::size_t>(height_)) == camera.runs_size, name,
        "row table does not end with the runs");
  const auto width = static_cast<std::uint32_t>(width_);
  std::vector<std::uint32_t> area(camera.segments.size() + 1, 0);
  for (int y = 0; y < height_; ++y) {
    // Offsets first: row_bytes() may form pointers only once they are known to be inside.
    const std::uint32_t begin = pf::load_u32(index + 4 * static_cast<std::size_t>(y));
    const std::uint32_t end_at = pf::load_u32(index + 4 * static_cast<std::size_t>(y) + 4);
    check(begin <= end_at && end_at <= camera.runs_size, name, "row table is not increasing");
    auto [p, end] = row_bytes(camera, y);
    std::uint32_t length = 0, segment = 0, dynamic = 0;
    for (std::uint32_t x = 0; x < width; x += length) {
      check(pf::load_varint(p, end, length) && pf::load_varint(p, end, segment), name,
            "a row's segment runs are truncated");
      check(length >= 1 && length <= width - x, name, "a segment run does not fit its row");
      check(segment < area.size(), name, "a run refers to a segment that is not there");
      area[segment] += length;
      if (camera.priors[segment].dynamic != 0) dynamic += length;
    }
    for (; dynamic > 0; dynamic -= length) {
      check(pf::load_varint(p, end, length) && p != end, name, "a row's motion runs are truncated");
      check(length >= 1 && length <= dynamic, name, "a motion run does not fit its row");
      ++p;
    }
    check(p == end, name, "a row has bytes left over");
  }
  for (std::size_t k = 0; k < camera.segments.size(); ++k) {
    check(area[k + 1] == camera.segments[k].area, name, "a segment's area differs from its runs");
  }
}

const std::vector<PriorSegment>& PriorFile::segments(CameraSide side) const {
  static const std::vector<PriorSegment> none;
  const auto index = static_cast<std::size_t>(side);
  return index < cameras_.size() ? cameras_[index].segments : none;
}

std::span<const kys::Prior> PriorFile::segment_priors(CameraSide side) const {
  const auto index = static_cast<std::size_t>(side);
  if (index >= cameras_.size()) return {};
  return std::span(cameras_[index].priors).subspan(1);
}

namespace {

/// A keypoint's pixel and its place in the caller's list.
struct Query {
  std::uint16_t x = 0;
  std::uint32_t index = 0;
};

/// Queries grouped by row and in order of x within each: offset[y]..offset[y+1].
void group_by_row(std::span<const Keypoint> keypoints, int width, int height,
                  std::vector<std::uint32_t>& offset, std::vector<Query>& queries) {
  // The nearest pixel of a keypoint is floor(. + 0.5): what is not below 0 need only be cut off.
  // Comparisons with NaN are false: such a keypoint is outside.
  const auto inside = [&](const Keypoint& k) {
    const float x = k.x + 0.5F, y = k.y + 0.5F;
    return x >= 0 && y >= 0 && x < static_cast<float>(width) && y < static_cast<float>(height);
  };
  const auto row = [](const Keypoint& k) { return static_cast<std::size_t>(k.y + 0.5F); };
  offset.assign(static_cast<std::size_t>(height) + 2, 0);
  for (const Keypoint& k : keypoints) {
    if (inside(k)) ++offset[row(k) + 2];
  }
  std::partial_sum(offset.begin(), offset.end(), offset.begin());
  queries.resize(offset.back());
  for (std::size_t i = 0; i < keypoints.size(); ++i) {
    const Keypoint& k = keypoints[i];
    if (!inside(k)) continue;
    queries[offset[row(k) + 1]++] = {static_cast<std::uint16_t>(k.x + 0.5F),
                                     static_cast<std::uint32_t>(i)};
  }
  for (std::size_t y = 0; y < static_cast<std::size_t>(height); ++y) {
    std::sort(queries.begin() + offset[y], queries.begin() + offset[y + 1],
              [](const Query& a, const Query& b) { return a.x < b.x; });
  }
}

}  // namespace

void PriorFile::lookup(CameraSide side, std::span<const Keypoint> keypoints,
                       std::span<kys::Prior> out) const {
  if (out.size() != keypoints.size()) {
    throw std::invalid_argument("PriorFile::lookup: one output per keypoint");
  }
  std::fill(out.begin(), out.end(), kys::Prior{});
  const auto camera_index = static_cast<std::size_t>(side);
  if (camera_index >= cameras_.size()) return;
  const CameraView& camera = cameras_[camera_index];
  std::vector<std::uint32_t> offset;
  std::vector<Query> queries;
  group_by_row(keypoints, width_, height_, offset, queries);

  const auto& motion = pf::motion_of_code();
  const auto& log_motion = log_motion_of_code();
  const auto width = static_cast<std::uint32_t>(width_);
  std::vector<std::pair<std::uint32_t, std::uint32_t>> moving;  // flagged pixels before it, index
  for (int y = 0; y < height_; ++y) {
    std::size_t q = offset[static_cast<std::size_t>(y)];
    const std::size_t q_end = offset[static_cast<std::size_t>(y) + 1];
    if (q == q_end) continue;
    const std::uint8_t* p = row_bytes(camera, y).first;
    moving.clear();
    std::uint32_t dynamic = 0;
    for (std::uint32_t x = 0; x < width && (q < q_end || !moving.empty());) {
      const std::uint32_t length = pf::load_checked_varint(p);
      const kys::Prior& prior = camera.priors[pf::load_checked_varint(p)];
      for (; q < q_end && queries[q].x < x + length; ++q) {
        out[queries[q].index] = prior;
        if (prior.dynamic != 0) moving.emplace_back(dynamic + queries[q].x - x, queries[q].index);
      }
      if (prior.dynamic != 0) dynamic += length;
      x += length;
    }
    std::uint32_t covered = 0;
    std::uint8_t code = 0;
    for (const auto& [position, index] : moving) {
      while (covered <= position) {
        covered += pf::load_checked_varint(p);
        code = *p++;
      }
      out[index].motion = motion[code];
      out[index].log_motion = log_motion[code];
    }
  }
}

void PriorFile::expand_row(CameraSide side, int y, std::span<std::uint16_t> segment_of,
                           std::span<float> motion_of) const {
  const auto camera_index = static_cast<std::size_t>(side);
  const auto width = static_cast<std::size_t>(width_);
  if (camera_index >= cameras_.size() || y < 0 || y >= height_ || segment_of.size() != width ||
      motion_of.size() != width) {
    throw std::invalid_argument("PriorFile::expand_row: no such row");
  }
  const CameraView& camera = cameras_[camera_index];
  const std::uint8_t* p = row_bytes(camera, y).first;
  for (std::size_t x = 0; x < width;) {
    const std::size_t length = pf::load_checked_varint(p);
    const std::uint32_t segment = pf::load_checked_varint(p);
    std::fill_n(segment_of.begin() + static_cast<std::ptrdiff_t>(x), length,
                static_cast<std::uint16_t>(segment));
    x += length;
  }
  std::uint32_t left = 0;
  float value = 0;
  for (std::size_t x = 0; x < width; ++x) {
    motion_of[x] = 0;
    if (camera.priors[segment_of[x]].dynamic == 0) continue;
    if (left == 0) {
      left = pf::load_checked_varint(p);
      value = pf::motion_of_code()[*p++];
    }
    motion_of[x] = value;
    --left;
  }
}

}  // namespace kys_slam
