# SPDX-License-Identifier: BSD-3-Clause
# shellcheck shell=bash
# For scripts that try packages in new Debian systems. As root; needs mmdebstrap.

# A new Debian in a folder, unpacked from ROOT.tar, which is kept for a next time: make_root SUITE ROOT PACKAGE...
# DEBIAN_MIRROR: where packages come from, if not from Debian's own server. ARCHITECTURE: of the system, by default this
# machine's; another one needs QEMU as packaging/arm64_root.sh sets it up.
ARCHITECTURE=${ARCHITECTURE:-$(dpkg --print-architecture)}
make_root() {
  local suite=$1 root=$2 packages
  packages=$(IFS=, && echo "${*:3}")
  if [ ! -s "$root.tar" ]; then
    mkdir -p "$(dirname "$root")"
    mmdebstrap --quiet --variant=minbase --architectures="$ARCHITECTURE" ${packages:+--include="$packages"} "$suite" "$root.part.tar" \
      ${DEBIAN_MIRROR:+"$DEBIAN_MIRROR"}
    mv "$root.part.tar" "$root.tar"
  fi
  rm -rf --one-file-system "$root"
  mkdir -p "$root"
  tar -C "$root" -xpf "$root.tar"
  cp -L /etc/resolv.conf "$root/etc/"
}

# A command in it, without this system's environment: inside ROOT COMMAND...
inside() {
  chroot "$1" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive "${@:2}"
}
