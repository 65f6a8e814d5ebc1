#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Do the examples build and run on a new Debian 12 that has nothing but what libkys-slam-dev depends on,
# and the installed package? As root; needs debootstrap and 2 GB.
#   packaging/check_clean_root.sh BUILD ROOT      ROOT: folder of the new system, kept for a next time
set -euo pipefail
build=$(realpath "$1")
root=$(realpath -m "$2")
cd "$(dirname "$0")/.."
inside() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive "$@"; }

depends=$(sed -n 's/^  "\(libeigen3-dev, .*\)")$/\1/p' third_party/cmake/KysPackage.cmake | tr -d ,)
[ -n "$depends" ] || { echo "check_clean_root.sh: no dependencies in KysPackage.cmake" >&2; exit 2; }
if [ ! -x "$root/usr/bin/apt-get" ]; then
  debootstrap --variant=minbase bookworm "$root"
fi
cp /etc/resolv.conf "$root/etc/"
inside apt-get update -qq
# shellcheck disable=SC2086  # a list of packages
inside apt-get install -y -qq --no-install-recommends g++ cmake make $depends >/dev/null

rm -rf "$root/opt/kys-slam" "$root/project"
for component in kys kys_slam; do
  DESTDIR= cmake --install "$build" --prefix "$root/opt/kys-slam" --component $component >/dev/null
done
mkdir -p "$root/project/tests/system"
cp -r examples "$root/project/"
cp -r tests/support "$root/project/tests/"
cp -r tests/system/consumer tests/system/consumer.cmake "$root/project/tests/system/"
inside cmake -DINSTALLED=/opt/kys-slam -DCONSUMER=/project/tests/system/consumer -DWORK=/tmp/consumer \
  "-DGENERATOR=Unix Makefiles" -DCOMPILER=/usr/bin/c++ -DFLAGS= -P /project/tests/system/consumer.cmake
