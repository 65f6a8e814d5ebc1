#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Debian packages for the system this runs on, by CPack, and what lintian says of them.
#   packaging/make_debs.sh OUTPUT [OPTION...]      OPTION: of CMake, e.g. -DKYS_PACKAGE_CONTACT="NAME <MAIL>"
# Needs what tools/setup.sh installs, and lintian. An error of lintian ends it with status 1.
set -euo pipefail
if [ $# -lt 1 ] || [ "${1#-}" != "$1" ]; then
  sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0" >&2
  exit 2
fi
output=$(realpath -m "$1")
shift
cd "$(dirname "$0")/.."
# shellcheck source=packaging/build_env.sh
. packaging/build_env.sh
env=$(build_env /usr/bin/python3)  # Debian's own, for python3-kys-slam

cmake -G Ninja -S . -B build/package -DCMAKE_BUILD_TYPE=Release -DKYS_BUILD_TESTS=OFF -DKYS_BUILD_BENCHMARKS=OFF \
  -DPython3_EXECUTABLE="$env/bin/python" "$@"
cmake --build build/package
rm -rf build/package/debs
(cd build/package && cpack -G DEB -B "$PWD/debs")
mkdir -p "$output"
cp build/package/debs/*.deb "$output/"
lintian --allow-root --fail-on error --tag-display-limit 0 "$output"/*.deb | tee "$output/lintian.txt"
ls -l "$output"/*.deb
