#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Debian 12 for ARM64 on an x86-64 machine with Debian 12, to build and try packages in: its programs are run by QEMU,
# the compiler alone is this machine's cross-compiler. As root.
#   packaging/arm64_root.sh setup [PACKAGE...]   cross-compiler and QEMU, the system (1 GB), packages of Debian in it
#   packaging/arm64_root.sh run COMMAND...       a command in it, in this source tree
# The system is in build/arm64-root; what is the folder build in it is build/arm64-package here. CHROOT: another folder.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$(realpath -m "${CHROOT:-build/arm64-root}")
build=$PWD/build/arm64-package
tools=(g++-aarch64-linux-gnu ccache qemu-user-static binfmt-support mmdebstrap arch-test)
libraries=(build-essential cmake ninja-build pkg-config file ca-certificates python3-dev python3-venv python3-pip
  libsimde-dev libeigen3-dev libyaml-cpp-dev libcli11-dev libspdlog-dev libfmt-dev nlohmann-json3-dev libspng-dev
  libdeflate-dev libturbojpeg0-dev)
# What of the compiler is this machine's own.
cross=(gcc g++ cpp as ld ar nm ranlib strip objcopy objdump readelf)

# A command of ARM64 has to start as any other: the kernel hands it to QEMU.
start_qemu() {
  [ -e /proc/sys/fs/binfmt_misc/register ] || mount -t binfmt_misc binfmt_misc /proc/sys/fs/binfmt_misc
  [ -e /proc/sys/fs/binfmt_misc/qemu-aarch64 ] || update-binfmts --enable qemu-aarch64
}

setup() {  # PACKAGE...
  dpkg-query -W "${tools[@]}" >/dev/null 2>&1 || {
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${tools[@]}" >/dev/null
  }
  start_qemu
  if [ ! -d "$root" ]; then
    rm -rf --one-file-system "$root.part"
    mkdir -p "$(dirname "$root")"
    mmdebstrap --quiet --variant=minbase --architectures=arm64 --include="$(IFS=, && echo "${libraries[*]}")" \
      --dpkgopt='path-exclude=/usr/share/man/*' --dpkgopt='path-exclude=/usr/share/locale/*' \
      --dpkgopt=force-unsafe-io bookworm "$root.part" ${DEBIAN_MIRROR:+"$DEBIAN_MIRROR"}
    mv "$root.part" "$root"
  fi
  link_compiler
  if [ $# -gt 0 ]; then
    run sh -c 'apt-get update -qq && apt-get install -y -qq --no-install-recommends "$@" >/dev/null' sh "$@"
  fi
}

# By links: the compiler finds its parts beside the file that a link leads to.
link_compiler() {
  local name
  mkdir -p "$root/opt/cross/bin" "$root/host" "$root/lib64" "$root/usr/lib/x86_64-linux-gnu" \
    "$root/usr/aarch64-linux-gnu" "$root/source"
  for name in "${cross[@]}"; do
    ln -sfn "/host/usr/bin/aarch64-linux-gnu-$name" "$root/opt/cross/bin/$name"
    ln -sfn "/host/usr/bin/aarch64-linux-gnu-$name" "$root/opt/cross/bin/aarch64-linux-gnu-$name"
  done
  ln -sfn gcc "$root/opt/cross/bin/cc"
  ln -sfn g++ "$root/opt/cross/bin/c++"
  ln -sfn /host/usr/bin/ccache "$root/opt/cross/bin/ccache"
}

# The mounts are seen by this command alone and end with it.
run() {
  start_qemu
  mkdir -p "$build"
  cp -L /etc/resolv.conf "$root/etc/"
  epoch=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || stat -c %Y CHANGELOG.md)}
  unshare --mount sh -euc '
    root=$1 source=$2 build=$3; shift 3
    mount --bind / "$root/host"
    mount -o remount,bind,ro "$root/host"
    mount --bind /lib64 "$root/lib64"
    mount --bind /usr/lib/x86_64-linux-gnu "$root/usr/lib/x86_64-linux-gnu"
    mount --bind /usr/aarch64-linux-gnu "$root/usr/aarch64-linux-gnu"
    mount --bind "$source" "$root/source"
    mount --bind "$build" "$root/source/build"
    mount --bind /etc/ssl/certs "$root/etc/ssl/certs"
    mount -t proc proc "$root/proc"
    exec chroot "$root" "$@"' sh "$root" "$PWD" "$build" \
    env -i PATH=/opt/cross/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive \
    PIP_CERT=/etc/ssl/certs/ca-certificates.crt PIP_DISABLE_PIP_VERSION_CHECK=1 \
    CCACHE_DIR=/source/build/ccache CCACHE_COMPILERCHECK=content SOURCE_DATE_EPOCH="$epoch" \
    CMAKE_ARGS="${CMAKE_ARGS:-}" CMAKE_BUILD_PARALLEL_LEVEL="${CMAKE_BUILD_PARALLEL_LEVEL:-$(nproc)}" \
    sh -c 'cd /source && exec "$@"' sh "$@"
}

case "${1:-}" in
  setup | run) "$@" ;;
  *)
    sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0" >&2
    exit 2
    ;;
esac
