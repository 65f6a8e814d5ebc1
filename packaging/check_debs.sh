#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Do the Debian packages install on a new Debian 12, bring no more than they say, and do their programs run?
# As root; needs mmdebstrap and 2 GB.
#   packaging/check_debs.sh DEBS ROOTS        ROOTS: folder of the new system; its packed form is kept
# DEBIAN_MIRROR: where packages come from, if not from Debian's own server. SUITE: by default bookworm. What the
# packages need on top of the system is written to ROOTS/debs.sizes.
set -euo pipefail
if [ $# -ne 2 ] || [ ! -d "$1" ]; then
  sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0" >&2
  exit 2
fi
debs=$(realpath "$1")
roots=$(realpath -m "$2")
cd "$(dirname "$0")"
# shellcheck source=packaging/clean_root.sh
. ./clean_root.sh
root=$roots/debs
ours=(kys-slam python3-kys-slam kys-slam-simulator kys-slam-priors kys-slam-maps libkys-slam-dev)

make_root "${SUITE:-bookworm}" "$root"
inside "$root" apt-get update -qq
mkdir -p "$root/check/debs"
cp "$debs"/*.deb "$root/check/debs/"
cp check_installed.py "$root/check/"

size() { inside "$root" dpkg-query -W -f='${Installed-Size}\n' | awk '{s += $1} END {print s}'; }
absent() {  # packages that must not be there: absent WHY PATTERN
  if inside "$root" dpkg-query -W -f='${Package}\n' | grep -E "$2"; then
    echo "check_debs.sh: installed: $1" >&2
    exit 1
  fi
}
needed_by() {  # all that a package depends on
  inside "$root" apt-cache depends --recurse --installed --no-recommends --no-suggests --no-conflicts --no-breaks \
    --no-replaces --no-enhances "$1" | grep '^[a-z]'
}
: >"$roots/debs.sizes"
add() {  # PACKAGE: installs it, starts each of its programs
  local before program
  before=$(size)
  inside "$root" sh -c "apt-get install -y -qq --no-install-recommends /check/debs/$1_*.deb" >/dev/null
  echo "$1 $(($(size) - before))" >>"$roots/debs.sizes"
  for program in $(inside "$root" dpkg -L "$1" | grep ^/usr/bin/. || true); do
    inside "$root" "$program" --help >/dev/null
    if inside "$root" ldd "$program" 2>/dev/null | grep 'not found'; then exit 1; fi
  done
  inside "$root" test -s "/usr/share/doc/$1/copyright"
  inside "$root" test -s "/usr/share/doc/$1/$1.cdx.json"
}
run() { inside "$root" sh -c "cd /check && $*"; }

add kys-slam
add python3-kys-slam
absent "OpenCV, which neither needs" '^libopencv'
run kys-slam demo
run python3 check_installed.py work
run "run_stereo_kitti work/grey --output run --set orb.features=600 --save-map run.map --quiet &&
  cmp run/trajectory.tum work/run-grey/trajectory.tum && map_info run.map"
add kys-slam-simulator
run "simulate_sequence traffic --size 310x94 --frames 4 --output world"
absent "SuiteSparse, parts of which are under the GPL and which only kys-slam-maps needs" '^lib(cholmod|cxsparse|suitesparse)'
add kys-slam-maps
inside "$root" grep -q 'GPL-3' /usr/share/doc/kys-slam-maps/copyright
needed_by kys-slam-maps | grep ^libcholmod >/dev/null
run "refine_map run.map --output refined.map && run_stereo_kitti work/grey --load-map refined.map --localize-only \
  --set orb.features=600 --output again --quiet"
add kys-slam-priors
if needed_by kys-slam-priors | grep ^libcholmod; then exit 1; fi
run "build_priors world --output priors --panoptic-left world/panoptic_left --panoptic-right world/panoptic_right \
  --disparity sgbm --flow-left dis && validate_priors priors --sequence world"
absent "a compiler" '^(gcc|clang)-[0-9]+$'
add libkys-slam-dev
cat "$roots/debs.sizes"
inside "$root" apt-get purge -y -qq "${ours[@]}" >/dev/null
if inside "$root" find /usr -name '*kys*slam*' | grep .; then
  echo "check_debs.sh: left after removal" >&2
  exit 1
fi
echo "the packages install, run and are removed on ${SUITE:-bookworm}"
