// SPDX-License-Identifier: BSD-3-Clause
#include <kys/error.h>
#include <kys/label_space.h>
#include <kys_slam/error.h>
#include <kys_slam/feature_file.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/memory_limit.h>
#include <kys_slam/util/paths.h>
#include <libdeflate.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <numbers>
#include <span>
#include <stdexcept>

#include "camera/plausible.h"
#include "io/feature_payload.h"
#include "util/byte_stream.h"

namespace kys_slam {
namespace {

using byte_stream::ByteReader;
using byte_stream::ByteWriter;

namespace fs = std::filesystem;

constexpr char kMagic[8] = {'K', 'Y', 'S', 'F', 'E', 'A', 'T', '1'};
constexpr std::uint32_t kHeaderBytes = 96;
constexpr std::uint32_t kHeaderBytes2 = 144;  // of version 2
constexpr std::size_t kLabelSpaceBytes = 32;
constexpr std::uint64_t kMaxTruthBytes = std::uint64_t{1} << 33;
constexpr std::uint32_t kMaxFrameBytes = std::uint32_t{1} << 28;
constexpr std::uint32_t kPoseBytes = 64;
constexpr std::uint32_t kFrameHeadBytes = 12;     // before the payload: mark, size, checksum
constexpr std::uint32_t kFrameMark = 0x4d415246;  // "FRAM"
constexpr std::uint32_t kFeatureBytes = 44;
constexpr std::uint64_t kMaxFrames = 10'000'000;
constexpr double kAngleSteps = 65536.0 / (2.0 * std::numbers::pi);

std::uint32_t crc32_of(const std::vector<std::uint8_t>& bytes, std::size_t count) {
  return libdeflate_crc32(0, bytes.data(), count);
}

/// The truth as it is on disk, and its size before it was deflated.
struct PackedTruth {
  std::vector<std::uint8_t> bytes;
  std::uint64_t size = 0;
};

std::vector<std::uint8_t> pack_header(const FeatureFileInfo& info, const PackedTruth& truth) {
  ByteWriter p;
  for (const char c : kMagic) p.u8(static_cast<std::uint8_t>(c));
  p.u32(static_cast<std::uint32_t>(info.version));
  p.u32(info.version == 1 ? kHeaderBytes : kHeaderBytes2);
  p.u32(static_cast<std::uint32_t>(info.camera.width));
  p.u32(static_cast<std::uint32_t>(info.camera.height));
  for (const double v : {info.camera.fx, info.camera.fy, info.camera.cx, info.camera.cy,
                         info.camera.baseline, info.scale_factor}) {
    p.f64(v);
  }
  p.u64(info.seed);
  p.u64(info.poses.size());
  p.u32(static_cast<std::uint32_t>(info.levels));
  if (info.version != 1) {
    std::string name = info.label_space;
    name.resize(kLabelSpaceBytes);
    for (const char c : name) p.u8(static_cast<std::uint8_t>(c));
    p.u64(truth.bytes.size());
    p.u64(truth.size);
  }
  p.u32(crc32_of(p.bytes(), p.size()));
  return std::move(p.bytes());
}

std::vector<std::uint8_t> pack_poses(const std::vector<TimedPose>& poses) {
  ByteWriter p;
  p.reserve(poses.size() * kPoseBytes + 4);
  for (const TimedPose& pose : poses) {
    const auto& q = pose.T_w_c.rotation;
    const auto& t = pose.T_w_c.translation;
    for (const double v : {pose.timestamp, t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()}) {
      p.f64(v);
    }
  }
  p.u32(crc32_of(p.bytes(), p.size()));
  return std::move(p.bytes());
}

void pack_features(ByteWriter& p, const FeatureSet& set,
                   const std::vector<std::int32_t>& landmarks) {
  if (set.keypoints.size() != set.descriptors.size() || landmarks.size() != set.size()) {
    throw std::logic_error("features, descriptors and landmarks differ in number");
  }
  for (std::size_t i = 0; i < set.size(); ++i) {
    const Keypoint& k = set.keypoints[i];
    const auto fixed = [](float v) {
      return static_cast<std::uint16_t>(std::clamp(std::lround(v * 32.0F), 0L, 65535L));
    };
    p.u16(fixed(k.x));
    p.u16(fixed(k.y));
    p.u16(static_cast<std::uint16_t>(std::llround(k.angle * kAngleSteps) & 0xffff));
    p.u8(static_cast<std::uint8_t>(std::clamp(std::lround(k.response), 0L, 255L)));
    p.u8(k.octave);
    p.u32(static_cast<std::uint32_t>(landmarks[i]));
    for (const std::uint64_t word : set.descriptors[i].words) p.u64(word);
  }
}

void unpack_features(ByteReader& p, std::uint32_t count, FeatureSet& set,
                     std::vector<std::int32_t>& landmarks) {
  set.keypoints.resize(count);
  set.descriptors.resize(count);
  landmarks.resize(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    Keypoint& k = set.keypoints[i];
    k.x = static_cast<float>(p.u16()) / 32.0F;
    k.y = static_cast<float>(p.u16()) / 32.0F;
    k.angle = static_cast<float>(p.u16() / kAngleSteps);
    k.response = p.u8();
    k.octave = p.u8();
    landmarks[i] = static_cast<std::int32_t>(p.u32());
    for (std::uint64_t& word : set.descriptors[i].words) word = p.u64();
  }
}

struct FileCloser {
  void operator()(std::FILE* f) const { std::fclose(f); }
};
using File = std::unique_ptr<std::FILE, FileCloser>;

}  // namespace

struct FeatureSequenceWriter::Impl {
  fs::path path, temporary;
  File file;
  std::size_t frames_left = 0;
  int version = 1;
  std::uint64_t seed = 0;
  ByteWriter payload;

  void pack(const FeatureFrame& frame);
  [[noreturn]] void fail() const {
    throw InputError("cannot write " + path.string() + ": " + std::strerror(errno));
  }
  void put(const std::vector<std::uint8_t>& data) const {
    if (std::fwrite(data.data(), 1, data.size(), file.get()) != data.size()) fail();
  }
};

FeatureSequenceWriter::FeatureSequenceWriter(const fs::path& path, const FeatureFileInfo& info,
                                             const FeatureTruth& truth)
    : impl_(std::make_unique<Impl>()) {
  check_writable(path);
  impl_->path = behind_links(path);
  impl_->temporary = impl_->path;
  impl_->temporary += ".partial-" + std::to_string(getpid());
  impl_->file.reset(std::fopen(impl_->temporary.c_str(), "wb"));
  if (!impl_->file) impl_->fail();
  impl_->frames_left = info.poses.size();
  impl_->version = info.version;
  impl_->seed = info.seed;
  try {
    PackedTruth packed;
    if (info.version != 1) {
      const std::vector<std::uint8_t> plain = encode_truth(truth);
      ByteWriter p;
      p.raw(deflate(plain));
      p.u32(crc32_of(p.bytes(), p.size()));
      packed = {std::move(p.bytes()), plain.size()};
    }
    impl_->put(pack_header(info, packed));
    impl_->put(pack_poses(info.poses));
    impl_->put(packed.bytes);
  } catch (...) {
    std::error_code ignored;
    fs::remove(impl_->temporary, ignored);
    throw;
  }
}

FeatureSequenceWriter::~FeatureSequenceWriter() {
  if (!impl_->file) return;
  impl_->file.reset();
  std::error_code ignored;
  fs::remove(impl_->temporary, ignored);
}

void FeatureSequenceWriter::Impl::pack(const FeatureFrame& frame) {
  payload.clear();
  ByteWriter& p = payload;
  if (version == 1) {
    p.u32(static_cast<std::uint32_t>(frame.left.size()));
    p.u32(static_cast<std::uint32_t>(frame.right.size()));
    pack_features(p, frame.left, frame.left_landmarks);
    pack_features(p, frame.right, frame.right_landmarks);
    return;
  }
  const std::vector<std::uint8_t> plain = encode_frame(frame, seed);
  const std::vector<std::uint8_t> packed = deflate(plain);
  p.u32(static_cast<std::uint32_t>(plain.size()));
  p.raw(packed);
}

void FeatureSequenceWriter::write(const FeatureFrame& frame) {
  if (impl_->frames_left == 0) throw std::logic_error("more frames than poses");
  impl_->pack(frame);
  const std::vector<std::uint8_t>& payload = impl_->payload.bytes();
  ByteWriter h;
  h.u32(kFrameMark);
  h.u32(static_cast<std::uint32_t>(payload.size()));
  h.u32(crc32_of(payload, payload.size()));
  impl_->put(h.bytes());
  impl_->put(payload);
  --impl_->frames_left;
}

void FeatureSequenceWriter::finish() {
  if (impl_->frames_left != 0) throw std::logic_error("fewer frames than poses");
  const bool flushed = std::fflush(impl_->file.get()) == 0;
  if (!flushed) impl_->fail();
  if (std::fclose(impl_->file.release()) != 0) {
    const int reason = errno;
    std::error_code ignored;
    fs::remove(impl_->temporary, ignored);
    errno = reason;
    impl_->fail();
  }
  if (std::rename(impl_->temporary.c_str(), impl_->path.c_str()) != 0) {
    throw InputError("cannot write " + impl_->path.string() + ": " + std::strerror(errno) +
                     "; the whole file is " + impl_->temporary.string());
  }
}

struct FeatureSequence::Impl {
  std::string name;
  File file;
  std::uint64_t file_size = 0;
  FeatureFileInfo info;
  std::vector<TimedPose> truth;
  std::int64_t next_frame = 0;
  std::int64_t end = 0;
  std::vector<std::uint8_t> bytes;
  std::uint64_t header_bytes = kHeaderBytes;
  std::uint64_t truth_bytes = 0;  // on disk, with the checksum
  std::uint64_t truth_size = 0;   // inflated
  std::size_t labels = 0;         // of the label space; 0: not read yet
  FeatureFrame frame;             // the last one; its features have been handed out

  [[noreturn]] void fail(const std::string& what) const { throw InputError(name + ": " + what); }

  void get(std::size_t count, const char* what) {
    // A small file does not make much memory.
    if (count > file_size) fail(std::string("truncated in ") + what);
    check_memory(name, count);
    bytes.resize(count);
    if (std::fread(bytes.data(), 1, count, file.get()) != count) {
      fail(std::string("truncated in ") + what);
    }
  }
  std::uint64_t read_header();
  void read_poses(std::uint64_t frames);
  void read_header_2(ByteReader& p);
  void skip_frame();
  std::uint32_t read_head();
  void unpack_frame(std::uint32_t size, const std::string& where);
  void unpack_frame_2(std::uint32_t size);
  void check_labels(const std::string& where);
};

void FeatureSequence::Impl::read_header_2(ByteReader& p) {
  std::string padded(kLabelSpaceBytes, 0);
  for (char& c : padded) c = static_cast<char>(p.u8());
  info.label_space = padded.substr(0, padded.find('\0'));
  truth_bytes = p.u64();
  truth_size = p.u64();
}

// Returns the number of frames.
std::uint64_t FeatureSequence::Impl::read_header() {
  bytes.resize(kHeaderBytes2);
  std::size_t got = std::fread(bytes.data(), 1, kHeaderBytes, file.get());
  if (got < 8 || std::memcmp(bytes.data(), kMagic, 8) != 0) fail("not a feature file");
  if (got < kHeaderBytes) fail("truncated in the header");
  ByteReader p(std::span<const std::uint8_t>(bytes).subspan(8));
  const std::uint32_t version = p.u32();
  if (version != 1 && version != 2) {
    fail("version " + std::to_string(version) + " of the format is not known");
  }
  info.version = static_cast<int>(version);
  if (version == 2) header_bytes = kHeaderBytes2;
  if (p.u32() != header_bytes) fail("corrupt header (size)");
  got += std::fread(bytes.data() + got, 1, header_bytes - got, file.get());
  if (got < header_bytes) fail("truncated in the header");
  const std::uint32_t width = p.u32();
  const std::uint32_t height = p.u32();
  StereoCamera& c = info.camera;
  for (double* v : {&c.fx, &c.fy, &c.cx, &c.cy, &c.baseline, &info.scale_factor}) *v = p.f64();
  info.seed = p.u64();
  const std::uint64_t frames = p.u64();
  const std::uint32_t levels = p.u32();
  if (version == 2) read_header_2(p);
  if (p.u32() != crc32_of(bytes, header_bytes - 4)) fail("corrupt header (checksum)");
  if (width > 2048 || height > 2048) fail("image size out of range");
  c.width = static_cast<int>(width);
  c.height = static_cast<int>(height);
  if (!c.is_valid()) fail("the camera makes no sense");
  require_plausible(c, name);
  if (!(info.scale_factor > 1 && info.scale_factor < 4) || levels < 1 || levels > 64) {
    fail("the octaves make no sense");
  }
  info.levels = static_cast<int>(levels);
  if (frames == 0 || frames > kMaxFrames) fail("number of frames out of range");
  return frames;
}

void FeatureSequence::Impl::read_poses(std::uint64_t frames) {
  // Before anything is allocated: each frame needs at least its pose and an empty block.
  if (file_size < header_bytes + 4 + frames * (kPoseBytes + kFrameHeadBytes + 4)) {
    fail("truncated: too short for " + std::to_string(frames) + " frames");
  }
  if (truth_bytes > file_size || truth_size > kMaxTruthBytes ||
      (info.version == 2 && truth_bytes < 4)) {
    fail("truncated: too short for the objects");
  }
  get(frames * kPoseBytes + 4, "the poses");
  ByteReader p(bytes);
  double last = -std::numeric_limits<double>::infinity();
  for (std::uint64_t i = 0; i < frames; ++i) {
    double v[8];
    for (double& x : v) x = p.f64();
    const Eigen::Quaterniond q(v[7], v[4], v[5], v[6]);
    const bool finite = std::all_of(v, v + 8, [](double x) { return std::isfinite(x); });
    if (!finite || std::abs(q.norm() - 1) > 1e-3 || v[0] <= last) {
      fail("pose " + std::to_string(i) + " makes no sense");
    }
    last = v[0];
    info.poses.push_back({v[0], Rigid3(q, Eigen::Vector3d(v[1], v[2], v[3]))});
  }
  if (p.u32() != crc32_of(bytes, frames * kPoseBytes)) fail("corrupt poses (checksum)");
}

std::uint32_t FeatureSequence::Impl::read_head() {
  const std::string where = "frame " + std::to_string(next_frame);
  get(kFrameHeadBytes, where.c_str());
  ByteReader p(bytes);
  const bool marked = p.u32() == kFrameMark;
  const std::uint32_t size = p.u32();
  const bool fits = info.version == 1 ? size >= 8 && (size - 8) % kFeatureBytes == 0 &&
                                            size <= 8 + 2 * kMaxFeatures * kFeatureBytes
                                      : size >= 4 && size <= kMaxFrameBytes;
  if (!marked || !fits) fail("corrupt at " + where);
  return size;
}

void FeatureSequence::Impl::skip_frame() {
  const std::uint32_t size = read_head();
  if (std::fseek(file.get(), static_cast<long>(size), SEEK_CUR) != 0) fail("cannot seek");
  ++next_frame;
}

FeatureSequence::FeatureSequence(const fs::path& path, std::int64_t start, std::int64_t frames)
    : impl_(std::make_unique<Impl>()) {
  impl_->name = path.string();
  impl_->file.reset(std::fopen(path.c_str(), "rb"));
  if (!impl_->file) throw InputError("cannot read " + path.string() + ": " + std::strerror(errno));
  std::error_code error;
  impl_->file_size = fs::file_size(path, error);
  if (error) throw InputError("cannot read " + path.string() + ": " + error.message());
  const std::uint64_t total = impl_->read_header();
  impl_->read_poses(total);
  const auto count = static_cast<std::int64_t>(total);
  if (start < 0 || start >= count) {
    impl_->fail("has " + std::to_string(count) + " frames, none at " + std::to_string(start));
  }
  impl_->end = frames < 0 || frames > count - start ? count : start + frames;
  impl_->truth.assign(impl_->info.poses.begin() + start, impl_->info.poses.begin() + impl_->end);
  if (std::fseek(impl_->file.get(), static_cast<long>(impl_->truth_bytes), SEEK_CUR) != 0) {
    impl_->fail("cannot seek");
  }
  while (impl_->next_frame < start) impl_->skip_frame();
}

FeatureSequence::~FeatureSequence() = default;

const StereoCamera& FeatureSequence::camera() const {
  return impl_->info.camera;
}

std::optional<std::int64_t> FeatureSequence::size() const {
  return static_cast<std::int64_t>(impl_->truth.size());
}

void FeatureSequence::Impl::unpack_frame_2(std::uint32_t size) {
  const std::uint32_t plain = ByteReader(bytes).u32();
  if (plain > kMaxFrameBytes) throw std::runtime_error("the size makes no sense");
  frame = decode_frame(inflate(std::span(bytes).subspan(4, size - 4), plain), info.seed);
}

void FeatureSequence::Impl::check_labels(const std::string& where) {
  if (info.label_space.empty()) fail(where + ": priors of no label space");
  if (labels == 0) {
    try {
      labels = kys::load_label_space(info.label_space).size();
    } catch (const kys::Error& error) {
      fail(error.what());
    }
  }
  for (const auto* priors : {&frame.left_priors, &frame.right_priors}) {
    for (const kys::Prior& p : *priors) {
      if (p.label == kys::kVoidLabel || p.label < labels) continue;
      fail(where + ": label " + std::to_string(p.label) + " is not in label space " +
           info.label_space);
    }
  }
}

// From `bytes`, whose checksum is right.
void FeatureSequence::Impl::unpack_frame(std::uint32_t size, const std::string& where) {
  if (info.version == 2) {
    try {
      unpack_frame_2(size);
    } catch (const std::runtime_error& error) {
      fail("corrupt " + where + " (" + error.what() + ")");
    }
    if (frame.has_priors) check_labels(where);
    return;
  }
  ByteReader p(bytes);
  const std::uint32_t left = p.u32();
  const std::uint32_t right = p.u32();
  if (static_cast<std::uint64_t>(left) + right != (size - 8) / kFeatureBytes) {
    fail("corrupt " + where + " (counts)");
  }
  if (left > kMaxFeatures || right > kMaxFeatures) fail(where + ": too many features");
  frame = {};
  unpack_features(p, left, frame.left, frame.left_landmarks);
  unpack_features(p, right, frame.right, frame.right_landmarks);
}

std::optional<StereoFrame> FeatureSequence::next() {
  Impl& s = *impl_;
  if (s.next_frame >= s.end) return std::nullopt;
  const std::string where = "frame " + std::to_string(s.next_frame);
  const std::uint32_t size = s.read_head();
  const std::uint32_t checksum =
      ByteReader(std::span<const std::uint8_t>(s.bytes).subspan(8)).u32();
  s.get(size, where.c_str());
  if (crc32_of(s.bytes, size) != checksum) s.fail("corrupt " + where + " (checksum)");
  s.unpack_frame(size, where);
  StereoFrame frame;
  frame.index = s.next_frame;
  char text[32];
  std::snprintf(text, sizeof text, "%06lld", static_cast<long long>(s.next_frame));
  frame.name = text;
  frame.timestamp = s.info.poses[static_cast<std::size_t>(s.next_frame)].timestamp;
  for (const FeatureSet* set : {&s.frame.left, &s.frame.right}) {
    for (const Keypoint& k : set->keypoints) {
      if (k.octave >= s.info.levels || k.x > static_cast<float>(s.info.camera.width - 1) ||
          k.y > static_cast<float>(s.info.camera.height - 1)) {
        s.fail(where + ": a feature outside the image or the octaves");
      }
    }
  }
  frame.left_features = std::move(s.frame.left);
  frame.right_features = std::move(s.frame.right);
  frame.has_priors = s.frame.has_priors;
  frame.left_priors = std::move(s.frame.left_priors);
  frame.right_priors = std::move(s.frame.right_priors);
  ++s.next_frame;
  return frame;
}

const FeatureFileInfo& FeatureSequence::info() const {
  return impl_->info;
}
const std::vector<TimedPose>& FeatureSequence::ground_truth() const {
  return impl_->truth;
}
const std::vector<std::int32_t>& FeatureSequence::left_landmarks() const {
  return impl_->frame.left_landmarks;
}
const std::vector<std::int32_t>& FeatureSequence::right_landmarks() const {
  return impl_->frame.right_landmarks;
}

float FeatureSequence::mover_share() const {
  return impl_->frame.mover_share;
}

FeatureTruth FeatureSequence::truth() const {
  const Impl& s = *impl_;
  if (s.info.version == 1) return {};
  const File file(std::fopen(s.name.c_str(), "rb"));
  const auto at = static_cast<long>(s.header_bytes + s.info.poses.size() * kPoseBytes + 4);
  std::vector<std::uint8_t> bytes(s.truth_bytes);
  if (!file || std::fseek(file.get(), at, SEEK_SET) != 0 ||
      std::fread(bytes.data(), 1, bytes.size(), file.get()) != bytes.size()) {
    s.fail("truncated in the objects");
  }
  const std::size_t packed = bytes.size() - 4;
  if (ByteReader(std::span<const std::uint8_t>(bytes).subspan(packed)).u32() !=
      crc32_of(bytes, packed)) {
    s.fail("corrupt objects (checksum)");
  }
  try {
    return decode_truth(inflate(std::span(bytes).first(packed), s.truth_size),
                        static_cast<std::int64_t>(s.info.poses.size()));
  } catch (const std::runtime_error& error) {
    s.fail(std::string("corrupt objects (") + error.what() + ")");
  }
}

bool is_feature_file(const fs::path& path) {
  const File file(std::fopen(path.c_str(), "rb"));
  char head[8];
  return file && std::fread(head, 1, 8, file.get()) == 8 && std::memcmp(head, kMagic, 8) == 0;
}

}  // namespace kys_slam
