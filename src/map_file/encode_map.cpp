// SPDX-License-Identifier: BSD-3-Clause
#include <kys/label_space.h>

#include <cmath>
#include <stdexcept>

#include "map_file/map_file.h"
#include "map_file/map_format.h"

namespace kys_slam {

namespace {

namespace mf = map_format;
using mf::ByteWriter;

/// The columns of a keyframe lie one after the other. There is one NaN.
template <typename Get>
void column_f32(ByteWriter& out, std::size_t n, Get get) {
  for (std::size_t i = 0; i < n; ++i) {
    const float x = get(i);
    out.f32(std::isnan(x) ? std::numeric_limits<float>::quiet_NaN() : x);
  }
}

void write_pose(ByteWriter& out, const Rigid3& T) {
  for (const double x : T.rotation.coeffs()) out.f64(x);
  for (const double x : T.translation) out.f64(x);
}

void write_prior(ByteWriter& out, const kys::Prior& prior) {
  out.u16(prior.label);
  out.u8(static_cast<std::uint8_t>((prior.dynamic != 0 ? mf::kMoves : 0) |
                                   (prior.unjudged != 0 ? mf::kNotJudged : 0)));
  out.u32(static_cast<std::uint32_t>(prior.instance));
  out.f32(prior.scale);
  out.f32(prior.motion);
}

void write_descriptor(ByteWriter& out, const kys::Descriptor& descriptor) {
  for (const std::uint64_t word : descriptor.words) out.u64(word);
}

void write_extractor(ByteWriter& out, const ScaleLevels& scales) {
  out.u8(static_cast<std::uint8_t>(scales.extractor.size()));
  for (const char c : scales.extractor) out.u8(static_cast<std::uint8_t>(c));
  out.u8(scales.sizes ? 1 : 0);
  out.f32(scales.reach);
  out.f32(scales.pixel_sigma);
  out.u8(scales.distances.measured() ? 1 : 0);
  for (const float d : scales.distances.matching) out.f32(d);
  for (const float d : scales.distances.other) out.f32(d);
}

void write_shared(ByteWriter& out, const MapContents& contents, std::string_view label_space) {
  const StereoCamera& camera = contents.camera;
  out.u32(static_cast<std::uint32_t>(camera.width));
  out.u32(static_cast<std::uint32_t>(camera.height));
  for (const double x : {camera.fx, camera.fy, camera.cx, camera.cy, camera.baseline}) out.f64(x);
  out.u8(static_cast<std::uint8_t>(RigCorrection::kSize));
  for (const double x : contents.rig.correction.parameters()) out.f64(x);
  for (int c = 0; c < RigCorrection::kSize; ++c) {
    for (int r = c; r < RigCorrection::kSize; ++r) out.f64(contents.rig.covariance(r, c));
  }
  out.f32(contents.scales.log_factor);
  out.u32(static_cast<std::uint32_t>(contents.scales.scale.size()));
  for (const float s : contents.scales.scale) out.f32(s);
  out.u32(contents.keyframe_id_end);
  out.u32(contents.landmark_id_end);
  out.u8(static_cast<std::uint8_t>(label_space.size()));
  for (const char c : label_space) out.u8(static_cast<std::uint8_t>(c));
  if (contents.scales.extractor != kOrbName) write_extractor(out, contents.scales);
}

void write_features(ByteWriter& out, const FrameFeatures& features) {
  const std::size_t n = features.size();
  out.u32(static_cast<std::uint32_t>(n));
  const bool aligned = !features.aligned().empty();
  const bool rows = features.measures_rows();
  out.u8(static_cast<std::uint8_t>((features.priors().empty() ? 0 : mf::kHasPriors) |
                                   (aligned ? mf::kHasAligned : 0) | (rows ? mf::kHasRows : 0)));
  column_f32(out, n, [&](std::size_t i) { return features.measured(i).u; });
  column_f32(out, n, [&](std::size_t i) { return features.measured(i).v; });
  column_f32(out, n, [&](std::size_t i) { return features.keypoint(i).angle; });
  column_f32(out, n, [&](std::size_t i) { return features.keypoint(i).response; });
  column_f32(out, n, [&](std::size_t i) { return features.measured(i).u_right; });
  if (rows) column_f32(out, n, [&](std::size_t i) { return features.measured(i).v_right; });
  for (std::size_t i = 0; i < n; ++i) out.u8(features.keypoint(i).octave);
  for (std::size_t i = 0; i < n; ++i) write_descriptor(out, features.descriptor(i));
  for (const std::uint8_t flag : features.aligned()) out.u8(flag);
  for (const kys::Prior& prior : features.priors()) write_prior(out, prior);
}

void write_keyframe(ByteWriter& out, const KeyFrame& keyframe) {
  out.u32(keyframe.id.value);
  out.u32(keyframe.submap.value);
  out.u32(keyframe.parent.value);
  out.u64(static_cast<std::uint64_t>(keyframe.frame_index));
  out.f64(keyframe.timestamp);
  write_pose(out, keyframe.T_c_w);
  out.u32(static_cast<std::uint32_t>(keyframe.loop_edges.size()));
  for (const KeyFrameId id : keyframe.loop_edges) out.u32(id.value);
  write_features(out, *keyframe.features);
}

void write_culled(ByteWriter& out, const CulledKeyFrame& culled) {
  out.u32(culled.id.value);
  out.u32(culled.parent.value);
  write_pose(out, culled.T_c_parent);
}

void write_landmark(ByteWriter& out, const Landmark& landmark) {
  out.u32(landmark.id.value);
  out.u32(landmark.reference.value);
  out.u32(landmark.first_keyframe.value);
  out.u32(landmark.visible);
  out.u32(landmark.found);
  for (const double x : landmark.p_w) out.f64(x);
  for (const float x : landmark.normal) out.f32(x);
  out.f32(landmark.min_distance);
  out.f32(landmark.max_distance);
  write_descriptor(out, landmark.descriptor);
  write_prior(out, landmark.prior);
  out.u32(static_cast<std::uint32_t>(landmark.observations.size()));
  for (const Observation& o : landmark.observations) {
    out.u32(o.keyframe.value);
    out.u32(o.feature);
  }
}

/// One chunk per `batch` objects.
template <typename T>
void write_chunks(ByteWriter& file, const std::vector<T>& objects, std::size_t batch,
                  void (*write)(ByteWriter&, const T&)) {
  ByteWriter chunk;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    write(chunk, objects[i]);
    if ((i + 1) % batch != 0 && i + 1 != objects.size()) continue;
    mf::append_chunk(file, chunk.bytes());
    chunk.clear();
  }
}

/// About, so that the largest buffer is taken once.
std::size_t estimate_size(const MapContents& contents) {
  std::size_t size = 1000 + 64 * contents.culled.size();
  for (const KeyFrame& k : contents.keyframes) {
    size += 150 + 53 * k.features->size() + 15 * k.features->priors().size();
  }
  for (const Landmark& l : contents.landmarks) size += 131 + 8 * l.observations.size();
  return size;
}

void check_label_space(const MapContents& contents, std::string_view label_space) {
  constexpr std::size_t kLongest = 255;  // its length is a byte
  if (!label_space.empty() && !kys::is_label_space_name(label_space, kLongest)) {
    throw std::invalid_argument("save_map: a label space's name has to be printable and short");
  }
  if (label_space.empty() && contents.has_priors()) {
    throw std::invalid_argument("save_map: a map with priors needs the name of their label space");
  }
}

}  // namespace

std::vector<std::uint8_t> encode_map(const Map& map, std::string_view label_space) {
  const MapContents contents = map.contents();
  check_label_space(contents, label_space);
  ByteWriter file;
  file.reserve(estimate_size(contents));
  file.raw(mf::kMagic);
  file.u16(contents.scales.extractor == kOrbName ? mf::kVersion : mf::kExtractorVersion);
  file.u16(mf::kHeaderSize);
  file.u32(0);  // checksum and
  file.u64(0);  // size follow
  file.u32(static_cast<std::uint32_t>(contents.keyframes.size()));
  file.u32(static_cast<std::uint32_t>(contents.culled.size()));
  file.u32(static_cast<std::uint32_t>(contents.landmarks.size()));
  file.u32(contents.beliefs ? mf::kHasBeliefs : 0);

  ByteWriter shared;
  write_shared(shared, contents, label_space);
  mf::append_chunk(file, shared.bytes());
  write_chunks(file, contents.keyframes, 1, write_keyframe);
  write_chunks(file, contents.culled, mf::kBatch, write_culled);
  write_chunks(file, contents.landmarks, mf::kBatch, write_landmark);
  file.put_u64(mf::kAtFileSize, file.size());
  file.put_u32(mf::kAtChecksum, mf::checksum(std::span(file.bytes()).subspan(mf::kAtChecked)));
  return std::move(file.bytes());
}

}  // namespace kys_slam
