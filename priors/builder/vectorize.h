#pragma once

/// KYS_ROW_LOOP before a function with loops over image rows: it is compiled for AVX2 as well and
/// the machine chooses at start-up. Results are the same, as nothing is contracted or reordered.
/// (Not under sanitizers, which do not get along with such functions.)
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define KYS_ROW_LOOP __attribute__((target_clones("avx2", "default")))
#else
#define KYS_ROW_LOOP
#endif
