// SPDX-License-Identifier: BSD-3-Clause
#include <kys/hamming.h>

#if defined(__x86_64__) && defined(__GNUC__)
#define KYS_X86_KERNELS 1
#include <immintrin.h>
#else
#define KYS_X86_KERNELS 0
#endif
#ifdef __ARM_NEON
#include <arm_neon.h>
#endif

namespace kys {

namespace detail {

#if KYS_X86_KERNELS
// Also in a library compiled for a machine with popcnt: its user may not be.
extern const bool has_popcnt;
const bool has_popcnt = [] {
  __builtin_cpu_init();
  return __builtin_cpu_supports("popcnt") != 0;
}();
#endif

namespace {

void many_one_by_one(const Descriptor& query, const Descriptor* descriptors,
                     const std::uint32_t* candidates, std::size_t count, std::int16_t* distances) {
  for (std::size_t i = 0; i < count; ++i) {
    distances[i] = static_cast<std::int16_t>(hamming(query, descriptors[candidates[i]]));
  }
}

#if KYS_X86_KERNELS
// Four candidates at a time: their differing bits are counted per 64-bit word, and the four words
// of the four candidates added up together.

#define KYS_AVX2 __attribute__((target("avx2"), always_inline)) inline
#define KYS_AVX512 __attribute__((target("avx2,avx512vl,avx512vpopcntdq"), always_inline)) inline

KYS_AVX2 __m256i load(const Descriptor& d) {
  return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(d.words.data()));
}

/// Four times four 64-bit counts to four 16-bit sums.
KYS_AVX2 void add_and_store(__m256i a, __m256i b, __m256i c, __m256i d, std::int16_t* sums) {
  const __m256i ab = _mm256_or_si256(a, _mm256_slli_epi64(b, 32));
  const __m256i cd = _mm256_or_si256(c, _mm256_slli_epi64(d, 32));
  const __m256i halves =
      _mm256_add_epi32(_mm256_unpacklo_epi64(ab, cd), _mm256_unpackhi_epi64(ab, cd));
  const __m128i sum =
      _mm_add_epi32(_mm256_castsi256_si128(halves), _mm256_extracti128_si256(halves, 1));
  _mm_storel_epi64(reinterpret_cast<__m128i*>(sums), _mm_packs_epi32(sum, sum));
}

/// Bits per 64-bit word, by a table of the bits of a nibble.
KYS_AVX2 __m256i count_avx2(__m256i words) {
  const __m256i table = _mm256_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4,  //
                                         0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4);
  const __m256i nibble = _mm256_set1_epi8(15);
  const __m256i low = _mm256_and_si256(words, nibble);
  const __m256i high = _mm256_and_si256(_mm256_srli_epi16(words, 4), nibble);
  return _mm256_sad_epu8(
      _mm256_add_epi8(_mm256_shuffle_epi8(table, low), _mm256_shuffle_epi8(table, high)),
      _mm256_setzero_si256());
}

KYS_AVX512 __m256i count_avx512(__m256i words) {
  return _mm256_popcnt_epi64(words);
}

__attribute__((target("avx2"))) void many_avx2(const Descriptor& query,
                                               const Descriptor* descriptors,
                                               const std::uint32_t* candidates, std::size_t count,
                                               std::int16_t* distances) {
  const __m256i q = load(query);
  std::size_t i = 0;
  for (; i + 4 <= count; i += 4) {
    const std::uint32_t* c = candidates + i;
    add_and_store(count_avx2(_mm256_xor_si256(q, load(descriptors[c[0]]))),
                  count_avx2(_mm256_xor_si256(q, load(descriptors[c[1]]))),
                  count_avx2(_mm256_xor_si256(q, load(descriptors[c[2]]))),
                  count_avx2(_mm256_xor_si256(q, load(descriptors[c[3]]))), distances + i);
  }
  many_one_by_one(query, descriptors, candidates + i, count - i, distances + i);
}

__attribute__((target("avx2,avx512vl,avx512vpopcntdq"))) void many_avx512(
    const Descriptor& query, const Descriptor* descriptors, const std::uint32_t* candidates,
    std::size_t count, std::int16_t* distances) {
  const __m256i q = load(query);
  std::size_t i = 0;
  for (; i + 4 <= count; i += 4) {
    const std::uint32_t* c = candidates + i;
    add_and_store(count_avx512(_mm256_xor_si256(q, load(descriptors[c[0]]))),
                  count_avx512(_mm256_xor_si256(q, load(descriptors[c[1]]))),
                  count_avx512(_mm256_xor_si256(q, load(descriptors[c[2]]))),
                  count_avx512(_mm256_xor_si256(q, load(descriptors[c[3]]))), distances + i);
  }
  many_one_by_one(query, descriptors, candidates + i, count - i, distances + i);
}
#endif

#ifdef __ARM_NEON
/// Differing bits of each of 16 pairs of bytes, 0..16.
inline uint8x16_t count_neon(uint8x16_t low, uint8x16_t high, const Descriptor& d) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(d.words.data());
  return vaddq_u8(vcntq_u8(veorq_u8(low, vld1q_u8(bytes))),
                  vcntq_u8(veorq_u8(high, vld1q_u8(bytes + 16))));
}

/// Four candidates at a time, whose counts are added up together.
void many_neon(const Descriptor& query, const Descriptor* descriptors,
               const std::uint32_t* candidates, std::size_t count, std::int16_t* distances) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(query.words.data());
  const uint8x16_t low = vld1q_u8(bytes);
  const uint8x16_t high = vld1q_u8(bytes + 16);
  std::size_t i = 0;
  for (; i + 4 <= count; i += 4) {
    const std::uint32_t* c = candidates + i;
    const uint8x16_t ab = vpaddq_u8(count_neon(low, high, descriptors[c[0]]),
                                    count_neon(low, high, descriptors[c[1]]));
    const uint8x16_t cd = vpaddq_u8(count_neon(low, high, descriptors[c[2]]),
                                    count_neon(low, high, descriptors[c[3]]));
    const uint16x8_t halves = vpaddlq_u8(vpaddq_u8(ab, cd));  // two per candidate, 0..128 each
    vst1_s16(distances + i, vreinterpret_s16_u16(vget_low_u16(vpaddq_u16(halves, halves))));
  }
  many_one_by_one(query, descriptors, candidates + i, count - i, distances + i);
}
#endif

}  // namespace

std::vector<HammingKernel> hamming_kernels() {
  std::vector<HammingKernel> kernels = {{"one_by_one", many_one_by_one}};
#if KYS_X86_KERNELS
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx2")) {
    kernels.push_back({"avx2", many_avx2});
    if (__builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512vpopcntdq")) {
      kernels.push_back({"avx512", many_avx512});
    }
  }
#endif
#ifdef __ARM_NEON
  kernels.push_back({"neon", many_neon});
#endif
  return kernels;
}

}  // namespace detail

void hamming_many(const Descriptor& query, std::span<const Descriptor> descriptors,
                  std::span<const std::uint32_t> candidates, std::span<std::int16_t> distances) {
  static const auto kFastest = detail::hamming_kernels().back().run;
  kFastest(query, descriptors.data(), candidates.data(), candidates.size(), distances.data());
}

}  // namespace kys
