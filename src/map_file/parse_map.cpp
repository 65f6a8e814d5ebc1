// SPDX-License-Identifier: BSD-3-Clause
#include <kys/error.h>
#include <kys/label_space.h>
#include <kys/prior.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <new>

#include "map_file/map_file.h"
#include "map_file/map_format.h"

namespace kys_slam {

namespace {

namespace mf = map_format;
using mf::ByteReader;
using mf::require;

constexpr std::size_t kPriorSize = 15;
constexpr std::size_t kFeatureSize = 5 * 4 + 1 + 32;  // without prior

struct Header {
  std::uint16_t version;
  std::uint32_t keyframes;
  std::uint32_t culled;
  std::uint32_t landmarks;
  std::uint32_t flags;
};

Header check_header(std::span<const std::uint8_t> bytes) {
  require(bytes.size() >= mf::kMagic.size() &&
              std::equal(mf::kMagic.begin(), mf::kMagic.end(), bytes.begin()),
          "is not a map file (bad magic number)");
  require(bytes.size() >= mf::kHeaderSize, "is truncated (no complete header)");
  ByteReader reader(bytes.subspan(mf::kAtVersion));
  const std::uint16_t version = reader.u16();
  if (version < mf::kOffsetVersion || version > mf::kExtractorVersion) {
    throw mf::Damage("has map format version " + std::to_string(version) +
                     ", this program reads versions " + std::to_string(mf::kOffsetVersion) +
                     " to " + std::to_string(mf::kExtractorVersion));
  }
  require(reader.u16() == mf::kHeaderSize, "has a header of wrong size");
  const std::uint32_t sum = reader.u32();
  const std::uint64_t size = reader.u64();
  if (size != bytes.size()) {
    throw mf::Damage("is truncated or has been extended: " + std::to_string(bytes.size()) +
                     " bytes, its header says " + std::to_string(size));
  }
  require(sum == mf::checksum(bytes.subspan(mf::kAtChecked)),
          "is corrupt (checksum does not match)");
  const Header header{version, reader.u32(), reader.u32(), reader.u32(), reader.u32()};
  require((header.flags & ~mf::kHasBeliefs) == 0, "has unknown flags");
  return header;
}

float read_f32(ByteReader& in, float low, float high, const char* what) {
  const float x = in.f32();
  require(x >= low && x <= high, what);  // false for NaN
  return x;
}

Rigid3 read_pose(ByteReader& in) {
  Rigid3 T;  // its constructor would normalise: other bits
  for (double& x : T.rotation.coeffs()) x = in.f64();
  require(std::abs(T.rotation.norm() - 1) < 1e-6, "has a rotation that is none");
  for (double& x : T.translation) {
    x = in.f64();
    require(std::abs(x) <= mf::kMaxMetres, "has a pose that is not finite");
  }
  return T;
}

kys::Prior read_prior(ByteReader& in) {
  const std::uint16_t label = in.u16();
  const std::uint8_t flags = in.u8();
  const auto instance = static_cast<std::int32_t>(in.u32());
  require((flags & ~(mf::kMoves | mf::kNotJudged)) == 0, "has a prior with an unknown flag");
  const float scale =
      read_f32(in, 0, std::numeric_limits<float>::max(), "has a prior whose scale is no number");
  const float motion = read_f32(in, 0, 100, "has a prior whose motion is not in 0..100");
  kys::Prior prior = kys::make_prior(label, instance, scale, motion, (flags & mf::kMoves) != 0);
  prior.unjudged = (flags & mf::kNotJudged) != 0 ? 1 : 0;
  return prior;
}

kys::Descriptor read_descriptor(ByteReader& in) {
  kys::Descriptor descriptor;
  for (std::uint64_t& word : descriptor.words) word = in.u64();
  return descriptor;
}

RigEstimate read_rig(ByteReader& in, const StereoCamera& camera) {
  constexpr double kMost = 1e4;  // of any parameter; px
  require(in.u8() == RigCorrection::kSize, "has a correction of the cameras of another size");
  RigCorrection::Parameters parameters;
  for (double& x : parameters) {
    x = in.f64();
    require(std::abs(x) <= kMost, "has no valid correction of the cameras");
  }
  require(parameters[static_cast<int>(RigParameter::kFocal)] > -0.5,
          "has no valid correction of the cameras");
  RigEstimate rig;
  rig.correction = RigCorrection(camera, parameters);
  for (int c = 0; c < RigCorrection::kSize; ++c) {
    for (int r = c; r < RigCorrection::kSize; ++r) {
      rig.covariance(r, c) = rig.covariance(c, r) = in.f64();
      require(std::abs(rig.covariance(r, c)) <= kMost * kMost,
              "has no valid covariance of the cameras");
    }
  }
  return rig;
}

/// The first chunk. \returns the name of the label space
/// What the extractor says of itself; its levels are read before.
void read_extractor(ByteReader& in, ScaleLevels& scales) {
  const auto name = in.raw(in.u8());
  ExtractorTraits traits;
  traits.name.assign(name.begin(), name.end());
  require(traits.name != kOrbName, "says in vain that its features are ORB's");
  const std::uint8_t sizes = in.u8();
  require(sizes <= 1, "has an extractor with an unknown flag");
  scales.sizes = sizes != 0;
  scales.reach = in.f32();
  scales.pixel_sigma = in.f32();
  traits.reach = scales.reach;
  traits.pixel_sigma = static_cast<double>(scales.pixel_sigma);
  const std::uint8_t measured = in.u8();
  require(measured <= 1, "has an extractor with an unknown flag");
  if (measured != 0) {
    scales.distances.matching.resize(kMatchingShares.size());
    scales.distances.other.resize(kOtherShares.size());
    for (float& d : scales.distances.matching) d = in.f32();
    for (float& d : scales.distances.other) d = in.f32();
  }
  traits.distances = scales.distances;
  try {
    check_traits(traits);
  } catch (const InputError& error) {
    throw mf::Damage(std::string("has no valid extractor: ") + error.what());
  }
  scales.extractor = traits.name;
}

std::string read_shared(ByteReader in, std::uint16_t version, MapContents& contents) {
  StereoCamera& camera = contents.camera;
  const std::uint32_t width = in.u32();
  const std::uint32_t height = in.u32();
  require(width <= mf::kMaxSide && height <= mf::kMaxSide, "has a camera of impossible size");
  camera.width = static_cast<int>(width);
  camera.height = static_cast<int>(height);
  for (double* x : {&camera.fx, &camera.fy, &camera.cx, &camera.cy, &camera.baseline}) {
    *x = in.f64();
    require(std::abs(*x) <= 1e6, "has a camera that makes no sense");
  }
  require(camera.is_valid(), "has a camera that makes no sense");
  if (version == mf::kOffsetVersion) {
    const float offset = read_f32(in, -1000, 1000, "has no valid disparity offset");
    contents.rig = RigCorrection::of_offset(camera, offset);
  } else {
    contents.rig = read_rig(in, camera);
  }
  contents.scales.log_factor = read_f32(in, -100, 100, "has no valid scale factor");
  const std::size_t levels = in.count(4);
  require(levels >= 1 && levels <= mf::kMaxLevels, "has no valid number of scale levels");
  for (std::size_t i = 0; i < levels; ++i) {
    contents.scales.scale.push_back(read_f32(in, 1e-6F, 1e6F, "has no valid scale level"));
  }
  contents.keyframe_id_end = in.u32();
  contents.landmark_id_end = in.u32();
  const auto bytes = in.raw(in.u8());
  const std::string name(bytes.begin(), bytes.end());
  require(name.empty() || kys::is_label_space_name(name, name.size()),
          "has a label space that is not printable");
  if (version == mf::kExtractorVersion) read_extractor(in, contents.scales);
  require(in.left() == 0, "has bytes too many");
  return name;
}

std::shared_ptr<const FrameFeatures> read_features(ByteReader& in, std::uint16_t version,
                                                   const MapContents& contents) {
  const std::size_t n = in.count(kFeatureSize);
  require(n <= std::numeric_limits<std::uint16_t>::max(), "has a keyframe of too many features");
  const std::uint8_t flags = in.u8();
  require((flags & ~(mf::kHasPriors | mf::kHasAligned | mf::kHasRows)) == 0,
          "has a keyframe with unknown flags");
  const bool with_priors = (flags & mf::kHasPriors) != 0;
  const bool with_aligned = (flags & mf::kHasAligned) != 0;
  const bool with_rows = (flags & mf::kHasRows) != 0;
  require(in.left() == n * (kFeatureSize + (with_priors ? kPriorSize : 0) + (with_aligned ? 1 : 0) +
                            (with_rows ? sizeof(float) : 0)),
          "has a keyframe of wrong size");
  FeatureSet set;
  set.keypoints.resize(n);
  const auto column = [&](float Keypoint::*member) {
    for (Keypoint& k : set.keypoints) {
      k.*member = read_f32(in, -mf::kMaxPixel, mf::kMaxPixel, "has a keypoint out of range");
    }
  };
  column(&Keypoint::x);
  column(&Keypoint::y);
  column(&Keypoint::angle);
  column(&Keypoint::response);
  RightPositions right;
  const auto read_right = [&](std::vector<float>& positions) {
    positions.resize(n);
    for (float& x : positions) {
      x = in.f32();
      require(std::isnan(x) || std::abs(x) <= mf::kMaxPixel, "has a stereo match out of range");
    }
  };
  read_right(right.u);
  if (with_rows) read_right(right.v);
  if (version == mf::kOffsetVersion) {  // columns contain the offset
    for (float& u : right.u) u += static_cast<float>(contents.rig.correction.offset());
  }
  for (Keypoint& k : set.keypoints) k.octave = in.u8();
  set.descriptors.reserve(n);
  for (std::size_t i = 0; i < n; ++i) set.descriptors.push_back(read_descriptor(in));
  std::vector<std::uint8_t> aligned(with_aligned ? n : 0);
  for (std::uint8_t& flag : aligned) {
    flag = in.u8();
    require(flag <= 1, "has a keyframe with unknown flags");
  }
  std::vector<kys::Prior> priors;
  for (std::size_t i = 0; with_priors && i < n; ++i) priors.push_back(read_prior(in));
  auto features = std::make_shared<const FrameFeatures>(
      FrameFeatures::restore(contents.camera, std::move(set), std::move(right), std::move(priors),
                             std::move(aligned), contents.rig.correction));
  for (std::size_t i = 0; i < n; ++i) {
    const bool sound = !features->has_stereo(i) || features->depth(i) < 1e30F;
    require(
        sound && std::isfinite(features->keypoint(i).x) && std::isfinite(features->keypoint(i).y),
        "has a stereo match out of range");
  }
  return features;
}

KeyFrame read_keyframe(ByteReader in, std::uint16_t version, const MapContents& contents) {
  KeyFrame keyframe;
  keyframe.id = {in.u32()};
  keyframe.submap = {in.u32()};
  keyframe.parent = {in.u32()};
  require(!keyframe.submap.valid() || keyframe.submap.value < contents.keyframe_id_end,
          "has a keyframe of an absent sub-map");
  const std::uint64_t index = in.u64();
  require(index <= std::numeric_limits<std::int64_t>::max(), "has a keyframe of a negative frame");
  keyframe.frame_index = static_cast<std::int64_t>(index);
  keyframe.timestamp = in.f64();
  require(std::isfinite(keyframe.timestamp), "has a time stamp that is not finite");
  keyframe.T_c_w = read_pose(in);
  keyframe.loop_edges.resize(in.count(4));
  for (KeyFrameId& id : keyframe.loop_edges) id = {in.u32()};
  keyframe.features = read_features(in, version, contents);
  return keyframe;
}

CulledKeyFrame read_culled(ByteReader& in) {
  return {.id = {in.u32()}, .parent = {in.u32()}, .T_c_parent = read_pose(in)};
}

Landmark read_landmark(ByteReader& in) {
  Landmark landmark;
  landmark.id = {in.u32()};
  landmark.reference = {in.u32()};
  landmark.first_keyframe = {in.u32()};
  landmark.visible = frame_count(in.u32());
  landmark.found = frame_count(in.u32());
  for (double& x : landmark.p_w) {
    x = in.f64();
    require(std::abs(x) <= mf::kMaxMetres, "has a landmark that is not finite");
  }
  for (float& x : landmark.normal) x = read_f32(in, -1.001F, 1.001F, "has no valid direction");
  constexpr float kFar = std::numeric_limits<float>::max();
  landmark.min_distance = read_f32(in, 0, kFar, "has no valid range of distances");
  landmark.max_distance = read_f32(in, 0, kFar, "has no valid range of distances");
  landmark.descriptor = read_descriptor(in);
  landmark.prior = read_prior(in);
  landmark.observations.resize(in.count(8));
  for (Observation& o : landmark.observations) o = {{in.u32()}, in.u32()};
  return landmark;
}

/// Reads `count` objects, kBatch in a chunk.
template <typename T>
void read_batches(ByteReader& file, std::uint32_t count, std::vector<T>& objects,
                  T (*read)(ByteReader&)) {
  while (objects.size() < count) {
    ByteReader in(mf::take_chunk(file));
    const std::size_t end = std::min<std::size_t>(count, objects.size() + mf::kBatch);
    while (objects.size() < end) objects.push_back(read(in));
    require(in.left() == 0, "has bytes too many");
  }
}

/// Tables are made as long as ids go: not much longer than the file gives reason to.
void check_id_ends(const MapContents& contents) {
  std::uint64_t features = 0;
  for (const KeyFrame& k : contents.keyframes) features += k.features->size();
  const std::uint64_t records = contents.keyframes.size() + contents.culled.size();
  const std::uint64_t landmarks =
      mf::kIdsPerObject * features + mf::kIdsPerCulled * contents.culled.size();
  require(contents.keyframe_id_end <= mf::kIdsAtLeast + mf::kIdsPerObject * records &&
              contents.landmark_id_end <= mf::kIdsAtLeast + landmarks,
          "has ids out of all proportion");
}

StoredMap parse(std::vector<std::uint8_t> bytes, std::optional<std::string_view> label_space) {
  const Header header = check_header(bytes);
  ByteReader file{std::span(bytes).subspan(mf::kHeaderSize)};
  MapContents contents;
  contents.beliefs = (header.flags & mf::kHasBeliefs) != 0;
  std::string stored_space =
      read_shared(ByteReader(mf::take_chunk(file)), header.version, contents);
  while (contents.keyframes.size() < header.keyframes) {
    contents.keyframes.push_back(
        read_keyframe(ByteReader(mf::take_chunk(file)), header.version, contents));
  }
  read_batches(file, header.culled, contents.culled, read_culled);
  read_batches(file, header.landmarks, contents.landmarks, read_landmark);
  require(file.left() == 0, "has bytes too many");
  bytes = {};
  check_id_ends(contents);
  if (label_space && stored_space != *label_space && contents.has_priors()) {
    throw mf::Damage("contains priors of label space '" + stored_space + "', configured is '" +
                     std::string(*label_space) + "'");
  }
  return {Map(std::move(contents)), std::move(stored_space), header.version};
}

}  // namespace

Map parse_map(std::vector<std::uint8_t> bytes, const std::string& name,
              std::optional<std::string_view> label_space) {
  return parse_stored_map(std::move(bytes), name, label_space).map;
}

StoredMap parse_stored_map(std::vector<std::uint8_t> bytes, const std::string& name,
                           std::optional<std::string_view> label_space) {
  try {
    return parse(std::move(bytes), label_space);
  } catch (const mf::Damage& damage) {
    throw InputError(name + ": " + damage.what());
  } catch (const std::logic_error& error) {
    throw InputError(name + ": contradicts itself: " + error.what());
  } catch (const std::bad_alloc&) {
    throw InputError(name + ": is larger than memory");
  }
}

}  // namespace kys_slam
