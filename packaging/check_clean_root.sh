#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Do the examples build and run on a new Debian 12 that has a compiler, libkys-slam-dev and what it depends on, and
# nothing else? As root; needs mmdebstrap and 2 GB.
#   packaging/check_clean_root.sh DEBS ROOTS      DEBS: folder of packages (make_debs.sh); ROOTS: of the new system
set -euo pipefail
if [ $# -ne 2 ] || [ ! -d "$1" ]; then
  sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0" >&2
  exit 2
fi
debs=$(realpath "$1")
root=$(realpath -m "$2")/development
cd "$(dirname "$0")/.."
# shellcheck source=packaging/clean_root.sh
. packaging/clean_root.sh
make_root bookworm "$root" g++ cmake make
mkdir -p "$root/debs" "$root/project/tests/system"
cp "$debs"/libkys-slam-dev_*.deb "$root/debs/"
inside "$root" apt-get update -qq
inside "$root" sh -c 'apt-get install -y -qq --no-install-recommends /debs/*.deb >/dev/null && dpkg -x /debs/*.deb /package'
cp -r examples "$root/project/"
cp -r tests/support "$root/project/tests/"
cp -r tests/system/consumer tests/system/consumer.cmake "$root/project/tests/system/"
inside "$root" cmake -DINSTALLED=/package/usr -DCONSUMER=/project/tests/system/consumer -DWORK=/tmp/consumer \
  "-DGENERATOR=Unix Makefiles" -DCOMPILER=/usr/bin/c++ -DFLAGS= -P /project/tests/system/consumer.cmake
