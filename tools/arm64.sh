#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# KYS-SLAM for ARM64 on an x86-64 machine with Debian 12: cross-compiled, run by QEMU.
#   tools/arm64.sh           all of the following
#   tools/arm64.sh setup     cross-compiler and QEMU (as root or with sudo, once), ARM64 libraries in
#                            build/arm64-sysroot (from Debian; 140 MB)
#   tools/arm64.sh build     kys, the core, the programs that track and unit tests, in build/arm64
#   tools/arm64.sh test      the unit tests
#   tools/arm64.sh compare [SEQUENCE[:FRAMES]...]
#                            the build for x86-64 (build/release, made if it is not there) gives the same bytes;
#                            by default 12 frames of two excerpts in KYS_SHARED_DATA_DIR, or of two worlds that
#                            it renders
set -euo pipefail
cd "$(dirname "$0")/.."
sysroot=$PWD/build/arm64-sysroot

packages=(g++-aarch64-linux-gnu qemu-user mmdebstrap cmake ninja-build pkg-config python3)
libraries=(libc6-dev libstdc++-12-dev libeigen3-dev libsimde-dev libyaml-cpp-dev libcli11-dev libspdlog-dev
  libfmt-dev nlohmann-json3-dev libspng-dev libdeflate-dev libturbojpeg0-dev libgtest-dev)

as_root() { if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi; }

setup() {
  if ! dpkg-query -W "${packages[@]}" >/dev/null 2>&1; then
    as_root apt-get update -qq
    as_root env DEBIAN_FRONTEND=noninteractive \
      apt-get install -y -qq --no-install-recommends "${packages[@]}" >/dev/null
  fi
  if [ -d "$sysroot" ]; then return; fi
  # Made beside its place: a broken download leaves nothing that seems complete.
  local part=$sysroot.part
  as_root rm -rf "$part"
  mkdir -p build
  as_root mmdebstrap --quiet --variant=extract --architectures=arm64 \
    --include="$(IFS=, && echo "${libraries[*]}")" \
    --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-exclude=/usr/share/man/*' \
    --dpkgopt='path-exclude=/usr/share/locale/*' \
    bookworm "$part" ${DEBIAN_MIRROR:+"$DEBIAN_MIRROR"}
  mv "$part" "$sysroot"
}

# -O1: the optimiser costs more time than it saves in these short runs, and changes no result. The inner
# loops are optimised all the same.
build() {
  cmake --preset arm64 -DKYS_UNITY_TESTS=ON -DCMAKE_UNITY_BUILD=ON -DKYS_WARNINGS_AS_ERRORS=ON \
    "-DCMAKE_CXX_FLAGS_RELEASE=-O1 -DNDEBUG"
  cmake --build build/arm64
}

run_tests() { ctest --test-dir build/arm64 -j "$(nproc)" --output-on-failure --timeout 900 -R '_test/'; }

compare() {
  local programs=(run_stereo_kitti run_stereo_euroc simulate_sequence) program
  for program in "${programs[@]}"; do
    if [ -x "build/release/bin/$program" ]; then continue; fi
    tools/setup.sh
    cmake --preset release
    cmake --build --preset release --target "${programs[@]}"
    break
  done
  local sequences=("$@") data=${KYS_SHARED_DATA_DIR:-../shared/data} name
  if [ "$#" -eq 0 ]; then
    for name in kitti_06_clip euroc_v101_start; do
      if [ -d "$data/$name" ]; then sequences+=("$data/$name:12"); fi
    done
  fi
  if [ "${#sequences[@]}" -eq 0 ]; then
    for name in block hall; do
      if [ ! -d "build/arm64/$name" ]; then
        build/release/bin/simulate_sequence "$name" --frames 12 --images-only --quiet --output "build/arm64/$name"
      fi
      sequences+=("build/arm64/$name")
    done
  fi
  python3 tests/regression/compare_recordings.py build/release build/arm64 \
    --emulator "qemu-aarch64 -L $sysroot" --output build/arm64/compared "${sequences[@]}"
}

case "${1:-}" in
  '')
    setup
    build
    run_tests
    compare
    ;;
  setup) setup ;;
  build) build ;;
  test) run_tests ;;
  compare)
    shift
    compare "$@"
    ;;
  *)
    sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0" >&2
    exit 2
    ;;
esac
