// SPDX-License-Identifier: BSD-3-Clause
#include "io/feature_payload.h"

#include <kys/error.h>
#include <kys/portable_math.h>
#include <kys/prior.h>
#include <kys_slam/util/hash.h>
#include <libdeflate.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>
#include <stdexcept>
#include <string>
#include <tuple>

#include "util/byte_stream.h"

namespace kys_slam {
namespace {

using byte_stream::ByteReader;
using byte_stream::ByteWriter;
using byte_stream::require;

constexpr double kAngleSteps = 65536.0 / (2.0 * std::numbers::pi);
constexpr std::uint32_t kMaxObjects = 10'000'000;
constexpr std::uint32_t kMaxLandmarks = 200'000'000;
constexpr int kDeflateLevel = 3;
constexpr std::uint8_t kHasPriors = 1;  // flag of a frame

// Numbers as byte planes: all low bytes, then all second bytes. They deflate better so.
template <typename Get>
void put_planes(ByteWriter& out, std::size_t count, int width, const Get& get) {
  for (int plane = 0; plane < width; ++plane) {
    for (std::size_t i = 0; i < count; ++i) {
      out.u8(static_cast<std::uint8_t>(static_cast<std::uint64_t>(get(i)) >> (8 * plane)));
    }
  }
}
template <typename Set>
void take_planes(ByteReader& in, std::size_t count, int width, const Set& set) {
  const std::uint8_t* p = in.raw(count * static_cast<std::size_t>(width)).data();
  for (std::size_t i = 0; i < count; ++i) {
    std::uint64_t v = 0;
    for (int plane = 0; plane < width; ++plane) {
      v |= static_cast<std::uint64_t>(p[static_cast<std::size_t>(plane) * count + i])
           << (8 * plane);
    }
    set(i, v);
  }
}

std::uint16_t fixed_pixel(float v) {
  return static_cast<std::uint16_t>(std::clamp(std::lround(v * 32.0F), 0L, 65535L));
}

// As in prior files: mu = 101^(q / 255) - 1.
std::uint8_t motion_code(float mu) {
  const double q = 255.0 * kys::portable::log1p(static_cast<double>(std::clamp(mu, 0.0F, 100.0F)));
  return static_cast<std::uint8_t>(std::lround(q / kys::portable::log(101.0)));
}
const std::array<float, 256>& motion_of_code() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> t{};
    for (std::size_t q = 0; q < 256; ++q) {
      t[q] = static_cast<float>(kys::portable::pow(101.0, static_cast<double>(q) / 255.0) - 1.0);
    }
    t[255] = 100;
    return t;
  }();
  return table;
}

struct CameraColumns {
  const FeatureSet& set;
  const std::vector<std::int32_t>& landmarks;
  const std::vector<DescriptorOrigin>& origins;
  const std::vector<kys::Prior>& priors;
};

void encode_keypoints(ByteWriter& w, const CameraColumns& c) {
  const std::size_t n = c.set.size();
  const auto& k = c.set.keypoints;
  put_planes(w, n, 2, [&](std::size_t i) { return fixed_pixel(k[i].x); });
  put_planes(w, n, 2, [&](std::size_t i) { return fixed_pixel(k[i].y); });
  put_planes(w, n, 2,
             [&](std::size_t i) { return std::llround(k[i].angle * kAngleSteps) & 0xffff; });
  put_planes(w, n, 1,
             [&](std::size_t i) { return std::clamp(std::lround(k[i].response), 0L, 255L); });
  put_planes(w, n, 1, [&](std::size_t i) { return k[i].octave; });
  put_planes(w, n, 4, [&](std::size_t i) { return static_cast<std::uint32_t>(c.landmarks[i]); });
}

// Positions of the bits that differ, each as its distance from the one before.
std::vector<std::uint8_t> flip_gaps(const kys::Descriptor& a, const kys::Descriptor& b) {
  std::vector<std::uint8_t> gaps;
  int last = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    for (std::uint64_t x = a.words[i] ^ b.words[i]; x != 0; x &= x - 1) {
      const int at = static_cast<int>(64 * i) + std::countr_zero(x);
      gaps.push_back(static_cast<std::uint8_t>(at - last));
      last = at;
    }
  }
  return gaps;
}

void encode_origins(ByteWriter& w, const CameraColumns& c, std::uint64_t seed) {
  const std::size_t n = c.set.size();
  std::vector<DescriptorOrigin> origins = c.origins;
  origins.resize(n);  // kRaw
  std::vector<std::uint8_t> counts, gaps;
  std::vector<std::uint64_t> families, states, raw;
  std::uint64_t last = 0;
  for (std::size_t i = 0; i < n; ++i) {
    DescriptorOrigin& origin = origins[i];
    const auto flips =
        flip_gaps(base_descriptor(origin, c.landmarks[i], seed), c.set.descriptors[i]);
    if (flips.size() > 200) origin = {};
    if (origin.kind == DescriptorOrigin::Kind::kRaw) {
      const auto& words = c.set.descriptors[i].words;
      raw.insert(raw.end(), words.begin(), words.end());
      continue;
    }
    if (origin.kind == DescriptorOrigin::Kind::kFamily) families.push_back(origin.value);
    if (origin.kind == DescriptorOrigin::Kind::kState) {
      states.push_back(origin.value - last);
      last = origin.value;
    }
    counts.push_back(static_cast<std::uint8_t>(flips.size()));
    gaps.insert(gaps.end(), flips.begin(), flips.end());
  }
  put_planes(w, n, 1, [&](std::size_t i) { return static_cast<std::uint8_t>(origins[i].kind); });
  put_planes(w, families.size(), 2, [&](std::size_t i) { return families[i]; });
  put_planes(w, states.size(), 8, [&](std::size_t i) { return states[i]; });
  put_planes(w, counts.size(), 1, [&](std::size_t i) { return counts[i]; });
  put_planes(w, gaps.size(), 1, [&](std::size_t i) { return gaps[i]; });
  put_planes(w, raw.size(), 8, [&](std::size_t i) { return raw[i]; });
}

void encode_priors(ByteWriter& w, const CameraColumns& c) {
  const std::size_t n = c.set.size();
  using Key = std::tuple<std::uint16_t, std::uint16_t, std::int32_t, float>;
  std::map<Key, std::uint16_t> index;
  std::vector<Key> segments;
  std::vector<std::uint16_t> segment_of(n, 0);
  for (std::size_t i = 0; i < n; ++i) {
    const kys::Prior& p = c.priors[i];
    if (p.label == kys::kVoidLabel) continue;
    const Key key{p.label, p.dynamic, p.instance, p.scale};
    const auto [at, is_new] =
        index.try_emplace(key, static_cast<std::uint16_t>(segments.size() + 1));
    if (is_new) segments.push_back(key);
    if (segments.size() > 65534) throw std::logic_error("too many segments in a frame");
    segment_of[i] = at->second;
  }
  w.u16(static_cast<std::uint16_t>(segments.size()));
  for (const auto& [label, dynamic, instance, scale] : segments) {
    w.u16(label);
    w.u16(dynamic);
    w.u32(static_cast<std::uint32_t>(instance));
    w.f32(scale);
  }
  put_planes(w, n, 2, [&](std::size_t i) { return segment_of[i]; });
  put_planes(w, n, 1, [&](std::size_t i) { return motion_code(c.priors[i].motion); });
}

void decode_keypoints(ByteReader& r, std::size_t n, FeatureSet& set,
                      std::vector<std::int32_t>& landmarks) {
  require(n * 12 <= r.left(), "too short");  // before anything is allocated
  set.keypoints.resize(n);
  set.descriptors.resize(n);
  landmarks.resize(n);
  auto& k = set.keypoints;
  const auto pixel = [](std::uint64_t v) { return static_cast<float>(v) / 32.0F; };
  take_planes(r, n, 2, [&](std::size_t i, std::uint64_t v) { k[i].x = pixel(v); });
  take_planes(r, n, 2, [&](std::size_t i, std::uint64_t v) { k[i].y = pixel(v); });
  take_planes(r, n, 2, [&](std::size_t i, std::uint64_t v) {
    k[i].angle = static_cast<float>(static_cast<double>(v) / kAngleSteps);
  });
  take_planes(r, n, 1,
              [&](std::size_t i, std::uint64_t v) { k[i].response = static_cast<float>(v); });
  take_planes(r, n, 1,
              [&](std::size_t i, std::uint64_t v) { k[i].octave = static_cast<std::uint8_t>(v); });
  take_planes(r, n, 4, [&](std::size_t i, std::uint64_t v) {
    landmarks[i] = static_cast<std::int32_t>(static_cast<std::uint32_t>(v));
  });
}

void flip(kys::Descriptor& d, const std::uint8_t* gaps, std::size_t count) {
  std::size_t at = 0;
  for (std::size_t i = 0; i < count; ++i) {
    at += gaps[i];
    require(at < 256, "a flipped bit beyond the descriptor");
    d.words[at / 64] ^= std::uint64_t{1} << (at % 64);
  }
}

void decode_origins(ByteReader& r, std::uint64_t seed, FeatureSet& set,
                    const std::vector<std::int32_t>& landmarks,
                    std::vector<DescriptorOrigin>& origins) {
  const std::size_t n = set.size();
  origins.resize(n);
  std::array<std::size_t, 4> count{};
  take_planes(r, n, 1, [&](std::size_t i, std::uint64_t v) {
    require(v < count.size(), "an unknown kind of descriptor");
    origins[i].kind = static_cast<DescriptorOrigin::Kind>(v);
    ++count[v];
  });
  const auto of_kind = [&](DescriptorOrigin::Kind kind) {
    return count[static_cast<std::size_t>(kind)];
  };
  std::vector<std::uint64_t> families(of_kind(DescriptorOrigin::Kind::kFamily));
  std::vector<std::uint64_t> states(of_kind(DescriptorOrigin::Kind::kState));
  take_planes(r, families.size(), 2, [&](std::size_t i, std::uint64_t v) { families[i] = v; });
  std::uint64_t last = 0;
  take_planes(r, states.size(), 8, [&](std::size_t i, std::uint64_t v) { states[i] = last += v; });
  const std::size_t keyed = n - of_kind(DescriptorOrigin::Kind::kRaw);
  const std::uint8_t* counts = r.raw(keyed).data();
  std::size_t gap_count = 0;
  for (std::size_t i = 0; i < keyed; ++i) gap_count += counts[i];
  const std::uint8_t* gaps = r.raw(gap_count).data();
  std::vector<std::uint64_t> raw(4 * of_kind(DescriptorOrigin::Kind::kRaw));
  take_planes(r, raw.size(), 8, [&](std::size_t i, std::uint64_t v) { raw[i] = v; });
  std::size_t family = 0, state = 0, word = 0;
  for (std::size_t i = 0; i < n; ++i) {
    kys::Descriptor& d = set.descriptors[i];
    if (origins[i].kind == DescriptorOrigin::Kind::kRaw) {
      for (std::uint64_t& w : d.words) w = raw[word++];
      continue;
    }
    if (origins[i].kind == DescriptorOrigin::Kind::kFamily) origins[i].value = families[family++];
    if (origins[i].kind == DescriptorOrigin::Kind::kState) origins[i].value = states[state++];
    d = base_descriptor(origins[i], landmarks[i], seed);
    flip(d, gaps, *counts);
    gaps += *counts++;
  }
}

void decode_priors(ByteReader& r, std::size_t n, std::vector<kys::Prior>& priors) {
  std::vector<kys::Prior> segments(static_cast<std::size_t>(r.u16()) + 1);
  try {
    for (std::size_t k = 1; k < segments.size(); ++k) {
      const std::uint16_t label = r.u16();
      const std::uint16_t dynamic = r.u16();
      const auto instance = static_cast<std::int32_t>(r.u32());
      require(dynamic <= 1 && label != kys::kVoidLabel && instance >= 0,
              "a segment makes no sense");
      segments[k] = kys::make_prior(label, instance, r.f32(), 0, dynamic != 0);
    }
  } catch (const kys::Error& error) {
    throw std::runtime_error(error.what());
  }
  priors.resize(n);
  take_planes(r, n, 2, [&](std::size_t i, std::uint64_t v) {
    require(v < segments.size(), "a feature of no segment");
    priors[i] = segments[v];
  });
  take_planes(r, n, 1, [&](std::size_t i, std::uint64_t v) {
    kys::Prior& p = priors[i];
    if (v == 0 || p.label == kys::kVoidLabel) return;
    p = kys::make_prior(p.label, p.instance, p.scale, motion_of_code()[v], p.dynamic != 0);
  });
}

}  // namespace

kys::Descriptor expand_descriptor(std::uint64_t key) {
  kys::Descriptor d;
  for (std::size_t i = 0; i < 4; ++i) d.words[i] = hash_of(key, 0xdec0de, i);
  return d;
}

kys::Descriptor base_descriptor(const DescriptorOrigin& origin, std::int32_t landmark,
                                std::uint64_t seed) {
  switch (origin.kind) {
    case DescriptorOrigin::Kind::kOwn:
      return expand_descriptor(hash_of(seed, 3, static_cast<std::uint64_t>(landmark)));
    case DescriptorOrigin::Kind::kFamily:
      return expand_descriptor(hash_of(seed, 4, origin.value));
    case DescriptorOrigin::Kind::kState:
      return expand_descriptor(mix(origin.value));
    case DescriptorOrigin::Kind::kRaw:
      break;
  }
  return {};
}

std::vector<std::uint8_t> encode_frame(const FeatureFrame& frame, std::uint64_t seed) {
  ByteWriter w;
  w.u32(static_cast<std::uint32_t>(frame.left.size()));
  w.u32(static_cast<std::uint32_t>(frame.right.size()));
  w.u8(frame.has_priors ? kHasPriors : 0);
  w.f32(frame.mover_share);
  for (const CameraColumns& c :
       {CameraColumns{frame.left, frame.left_landmarks, frame.left_origins, frame.left_priors},
        CameraColumns{frame.right, frame.right_landmarks, frame.right_origins,
                      frame.right_priors}}) {
    if (c.set.keypoints.size() != c.set.descriptors.size() || c.landmarks.size() != c.set.size() ||
        (!c.origins.empty() && c.origins.size() != c.set.size()) ||
        (frame.has_priors && c.priors.size() != c.set.size())) {
      throw std::logic_error("columns of a frame's features differ in length");
    }
    encode_keypoints(w, c);
    encode_origins(w, c, seed);
    if (frame.has_priors) encode_priors(w, c);
  }
  return std::move(w.bytes());
}

FeatureFrame decode_frame(std::span<const std::uint8_t> bytes, std::uint64_t seed) {
  ByteReader r(bytes);
  FeatureFrame f;
  const std::uint32_t left = r.u32();
  const std::uint32_t right = r.u32();
  require(left <= kMaxFeatures && right <= kMaxFeatures, "too many features");
  const std::uint8_t flags = r.u8();
  require(flags <= kHasPriors, "unknown flags");
  f.has_priors = flags != 0;
  f.mover_share = r.f32();
  require(f.mover_share >= 0 && f.mover_share <= 1, "the share of moving objects makes no sense");
  const auto camera = [&](std::size_t n, FeatureSet& set, std::vector<std::int32_t>& landmarks,
                          std::vector<DescriptorOrigin>& origins, std::vector<kys::Prior>& priors) {
    decode_keypoints(r, n, set, landmarks);
    decode_origins(r, seed, set, landmarks, origins);
    if (f.has_priors) decode_priors(r, n, priors);
  };
  camera(left, f.left, f.left_landmarks, f.left_origins, f.left_priors);
  camera(right, f.right, f.right_landmarks, f.right_origins, f.right_priors);
  r.expect_end();
  return f;
}

std::vector<std::uint8_t> encode_truth(const FeatureTruth& truth) {
  ByteWriter w;
  w.u32(static_cast<std::uint32_t>(truth.objects.size()));
  w.u32(static_cast<std::uint32_t>(truth.landmarks.size()));
  for (const FeatureObject& o : truth.objects) {
    w.u16(o.label);
    w.u16(static_cast<std::uint16_t>(o.kind));
    for (const float h : {o.half_size.x(), o.half_size.y(), o.half_size.z()}) w.f32(h);
    w.u32(static_cast<std::uint32_t>(o.first_frame));
    w.u32(static_cast<std::uint32_t>(o.poses.size()));
    for (const Rigid3& T : o.poses) {
      const auto& q = T.rotation;
      const auto& t = T.translation;
      for (const double v : {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()}) w.f64(v);
    }
  }
  const auto& l = truth.landmarks;
  for (int axis = 0; axis < 3; ++axis) {
    put_planes(w, l.size(), 4,
               [&](std::size_t i) { return std::bit_cast<std::uint32_t>(l[i].position[axis]); });
  }
  put_planes(w, l.size(), 4,
             [&](std::size_t i) { return static_cast<std::uint32_t>(l[i].object); });
  put_planes(w, l.size(), 2, [&](std::size_t i) { return l[i].label; });
  return std::move(w.bytes());
}

namespace {

FeatureObject decode_object(ByteReader& r, std::int64_t frames) {
  FeatureObject o;
  o.label = r.u16();
  const std::uint16_t kind = r.u16();
  require(kind <= static_cast<std::uint16_t>(FeatureObject::Kind::kArticulated),
          "an unknown kind of object");
  o.kind = static_cast<FeatureObject::Kind>(kind);
  for (int axis = 0; axis < 3; ++axis) {
    o.half_size[axis] = r.f32();
    require(o.half_size[axis] > 0 && o.half_size[axis] < 1e4F, "an object's size makes no sense");
  }
  o.first_frame = r.u32();
  const std::uint32_t poses = r.u32();
  const bool stands = o.kind == FeatureObject::Kind::kStatic;
  require(poses > 0 && (stands ? poses == 1 : o.first_frame + poses <= frames),
          "an object's poses leave the sequence");
  require(poses <= r.left() / 56, "too short");
  for (std::uint32_t i = 0; i < poses; ++i) {
    std::array<double, 7> v{};
    for (double& x : v) x = r.f64();
    const Eigen::Quaterniond q(v[6], v[3], v[4], v[5]);
    const bool finite = std::all_of(v.begin(), v.end(), [](double x) { return std::isfinite(x); });
    require(finite && std::abs(q.norm() - 1) < 1e-3, "an object's pose makes no sense");
    o.poses.emplace_back(q, Eigen::Vector3d(v[0], v[1], v[2]));
  }
  return o;
}

}  // namespace

FeatureTruth decode_truth(std::span<const std::uint8_t> bytes, std::int64_t frames) {
  ByteReader r(bytes);
  const std::uint32_t objects = r.u32();
  const std::uint32_t landmarks = r.u32();
  require(objects <= kMaxObjects && landmarks <= kMaxLandmarks, "numbers out of range");
  FeatureTruth truth;
  for (std::uint32_t i = 0; i < objects; ++i) truth.objects.push_back(decode_object(r, frames));
  require(r.left() == std::size_t{landmarks} * 18, "wrong length");
  auto& l = truth.landmarks;
  l.resize(landmarks);
  for (int axis = 0; axis < 3; ++axis) {
    take_planes(r, landmarks, 4, [&](std::size_t i, std::uint64_t v) {
      l[i].position[axis] = std::bit_cast<float>(static_cast<std::uint32_t>(v));
      require(std::isfinite(l[i].position[axis]), "a landmark is not finite");
    });
  }
  take_planes(r, landmarks, 4, [&](std::size_t i, std::uint64_t v) {
    l[i].object = static_cast<std::int32_t>(static_cast<std::uint32_t>(v));
    require(l[i].object >= -1 && l[i].object < static_cast<std::int64_t>(objects),
            "a landmark of no object");
  });
  take_planes(r, landmarks, 2,
              [&](std::size_t i, std::uint64_t v) { l[i].label = static_cast<std::uint16_t>(v); });
  return truth;
}

std::vector<std::uint8_t> deflate(std::span<const std::uint8_t> bytes) {
  const std::unique_ptr<libdeflate_compressor, void (*)(libdeflate_compressor*)> compressor(
      libdeflate_alloc_compressor(kDeflateLevel), libdeflate_free_compressor);
  if (!compressor) throw std::bad_alloc();
  std::vector<std::uint8_t> out(libdeflate_deflate_compress_bound(compressor.get(), bytes.size()));
  out.resize(libdeflate_deflate_compress(compressor.get(), bytes.data(), bytes.size(), out.data(),
                                         out.size()));
  return out;
}

std::vector<std::uint8_t> inflate(std::span<const std::uint8_t> bytes, std::size_t size) {
  // No stream of deflate grows by more than that: a small file does not make much memory.
  require(size <= 1032 * bytes.size() + 64, "the size makes no sense");
  const std::unique_ptr<libdeflate_decompressor, void (*)(libdeflate_decompressor*)> decompressor(
      libdeflate_alloc_decompressor(), libdeflate_free_decompressor);
  if (!decompressor) throw std::bad_alloc();
  std::vector<std::uint8_t> out(size);
  const libdeflate_result result = libdeflate_deflate_decompress(
      decompressor.get(), bytes.data(), bytes.size(), out.data(), size, nullptr);
  require(result == LIBDEFLATE_SUCCESS, "does not inflate");
  return out;
}

}  // namespace kys_slam
