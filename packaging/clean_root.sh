# SPDX-License-Identifier: BSD-3-Clause
# shellcheck shell=bash
# For scripts that try packages in new Debian systems. As root; needs mmdebstrap.

# A new Debian in a folder, kept for a next time: make_root SUITE ROOT PACKAGE...
make_root() {
  local suite=$1 root=$2 packages
  packages=$(IFS=, && echo "${*:3}")
  if [ ! -x "$root/usr/bin/apt-get" ]; then
    mkdir -p "$(dirname "$root")"
    mmdebstrap --quiet --variant=minbase ${packages:+--include="$packages"} "$suite" "$root" ${DEBIAN_MIRROR:+"$DEBIAN_MIRROR"}
  fi
  cp -L /etc/resolv.conf "$root/etc/"
}

# A command in it, without this system's environment: inside ROOT COMMAND...
inside() {
  chroot "$1" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive "${@:2}"
}
