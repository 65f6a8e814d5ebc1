#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# Shows that mode `stock` is plain ORB matching: the same sequence through the usual build and through
# a second one in which every descriptor distance is a plain popcount (KYS_PLAIN_POPCOUNT) must give
# the same trajectories and the same map, byte for byte.
#
#   tests/system/compare_plain_popcount.sh SEQUENCE [PROGRAM] [SECOND_BUILD]
#
# SEQUENCE      folder in a layout run_stereo_kitti understands
# PROGRAM       the usual run_stereo_kitti   (default: build/release/bin/run_stereo_kitti)
# SECOND_BUILD  build folder made or reused  (default: build/plain_popcount)
# Exit status 0: identical; 1: they differ; 2: something could not be built or run.
set -u
if [ $# -lt 1 ]; then
  sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0" >&2
  exit 2
fi
tree=$(cd "$(dirname "$0")/../.." && pwd)
sequence=$1
program=${2:-$tree/build/release/bin/run_stereo_kitti}
second=${3:-$tree/build/plain_popcount}

cmake -S "$tree" -B "$second" -G Ninja -DCMAKE_BUILD_TYPE=Release -DKYS_PLAIN_POPCOUNT=ON \
  -DKYS_BUILD_TESTS=OFF -DKYS_BUILD_BENCHMARKS=OFF -DKYS_BUILD_SIMULATOR=OFF >/dev/null || exit 2
cmake --build "$second" --target run_stereo_kitti >/dev/null || exit 2

work=$(mktemp -d) || exit 2
trap 'rm -rf "$work"' EXIT
"$program" "$sequence" --mode stock --schedule sequential --quiet --output "$work/usual" || exit 2
"$second/bin/run_stereo_kitti" "$sequence" --mode stock --schedule sequential --quiet \
  --output "$work/plain" || exit 2

status=0
for file in trajectory.tum trajectory.kitti keyframes.tum map.ply; do
  if cmp -s "$work/usual/$file" "$work/plain/$file"; then
    echo "identical: $file ($(wc -l <"$work/usual/$file") lines)"
  else
    echo "DIFFERENT: $file"
    status=1
  fi
done
exit $status
