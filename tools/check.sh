#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# One stage of continuous integration, from a clean checkout. What it costs: CONTRIBUTING.md.
#   tools/check.sh test     the README's test command; GCC, warnings are errors
#   tools/check.sh format   clang-format, licence lines
#   tools/check.sh asan [PROGRAM...]   Clang, warnings are errors; unit and system tests and hostile input,
#                           or the tests of some programs, under AddressSanitizer and UndefinedBehaviorSanitizer
#   tools/check.sh tsan     Clang; tests with threads under ThreadSanitizer
#   tools/check.sh clang    Clang, warnings are errors; everything, optimised; unit and system tests
#   tools/check.sh arm64    cross-compiled for ARM64: unit tests by QEMU, the same bytes as x86-64
#   tools/check.sh tidy     clang-tidy
set -euo pipefail
cd "$(dirname "$0")/.."
stage=${1:-}

# A build of the libraries, what the tests start, and the tests, with Clang: configure FOLDER OPTION...
configure() {
  tools/setup.sh --checks
  cmake -G Ninja -S . -B "$1" -DCMAKE_C_COMPILER=clang -DCMAKE_CXX_COMPILER=clang++ \
    -DKYS_WARNINGS_AS_ERRORS=ON -DKYS_BUILD_PYTHON=OFF "${@:2}"
}
# The same bytes from GCC as from Clang, where the stage `test` has left its build: same_bytes FOLDER
same_bytes() {
  [ -x build/release/bin/run_stereo_kitti ] || return 0
  python3 tests/regression/compare_builds.py build/release "$1" || [ $? = 77 ]
}
# Most tests of scripts need an optimised build.
run_tests() { ctest --test-dir "$1" -j "$(nproc)" --output-on-failure --timeout 900 "${@:2}"; }
# -O1: the optimiser costs more than it saves. Loops that have to be vectorised are not with checks in
# them. The renderer and the benchmarks stay out. Eight files are compiled as one (CMake's unity build),
# which takes half the time; the stage `test` compiles the libraries file by file.
sanitized=(-DCMAKE_BUILD_TYPE=RelWithDebInfo
  "-DCMAKE_CXX_FLAGS_RELWITHDEBINFO=-O1 -DNDEBUG -Wno-pass-failed"
  -DKYS_BUILD_SIMULATOR=OFF -DKYS_BUILD_BENCHMARKS=OFF -DCMAKE_UNITY_BUILD=ON)

case "$stage" in
  test)
    tools/setup.sh --browser
    tools/setup.sh --onnx
    exec tools/test.sh release -DKYS_WARNINGS_AS_ERRORS=ON -DKYS_UNITY_TESTS=ON
    ;;
  format)
    tools/setup.sh --format
    exec tools/lint.sh --format
    ;;
  tidy)
    tools/setup.sh --checks
    exec tools/lint.sh --all
    ;;
  clang)
    configure build/clang -DCMAKE_BUILD_TYPE=Release
    cmake --build build/clang
    run_tests build/clang -R '^[a-z_]*_test/'
    same_bytes build/clang
    ;;
  asan)
    configure build/clang-asan "${sanitized[@]}" -DKYS_SANITIZE=address,undefined
    programs=("${@:2}") tests='^[a-z_]*_test/|^hostile$'
    if [ "${#programs[@]}" -gt 0 ]; then tests="^($(IFS='|' && echo "${programs[*]}"))/"; fi
    cmake --build build/clang-asan ${programs[0]:+--target "${programs[@]}"}
    run_tests build/clang-asan -R "$tests"
    [ "${#programs[@]}" -gt 0 ] || same_bytes build/clang-asan
    ;;
  tsan)
    configure build/clang-tsan "${sanitized[@]}" -DKYS_SANITIZE=thread
    programs=(system_test io_test util_test kys_test matching_test priors_builder_test)
    cmake --build build/clang-tsan --target "${programs[@]}"
    threaded='PublicApi|TwoSystems|InRealTime|ThePipeline|ReadAhead|Worker|StereoMatcher|Thread|BuildSequence'
    run_tests build/clang-tsan -R "_test/.*($threaded)"
    ;;
  arm64) exec tools/arm64.sh ;;
  *)
    sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0" >&2
    exit 2
    ;;
esac
