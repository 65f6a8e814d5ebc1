#pragma once

// Functions marked KYS_VECTOR_CLONES are compiled for AVX2 and for the baseline, and the loader
// picks one when the program starts: portable binaries, no global -march.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_THREAD__) && !defined(__SANITIZE_ADDRESS__) && !defined(__AVX2__)
#define KYS_VECTOR_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define KYS_VECTOR_CLONES
#endif
