#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Do the wheels of packaging/make_wheel.sh run on new Debian systems that have Python and nothing else: no
# compiler, none of our libraries? The same trajectories on each? As root; needs mmdebstrap and 1 GB.
#   packaging/check_wheel_root.sh WHEELS ROOTS [RECORDING...]
# WHEELS: folder of wheels. ROOTS: folder of the new systems; their packed form is kept. RECORDING: tracked as well.
# DEBIAN_MIRROR: where packages come from, if not from Debian's own server. SUITES: by default Debian 12 and 13.
# ARCHITECTURE: amd64 or arm64, by default this machine's (clean_root.sh). EXPECTED: a file of digests that another
# call left, of the same recordings: these have to be the same.
set -euo pipefail
if [ $# -lt 2 ] || [ ! -d "$1" ]; then
  sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0" >&2
  exit 2
fi
expected=${EXPECTED:+$(realpath "$EXPECTED")}
wheels=$(realpath "$1")
roots=$(realpath -m "$2")
shift 2
recordings=()
for recording in "$@"; do recordings+=("$(realpath "$recording")"); done
cd "$(dirname "$0")"
# shellcheck source=packaging/clean_root.sh
. ./clean_root.sh
case "$ARCHITECTURE" in
  amd64) machine=x86_64 ;;
  arm64) machine=aarch64 ;;
  *) echo "check_wheel_root.sh: ARCHITECTURE is $ARCHITECTURE, not amd64 or arm64" >&2; exit 2 ;;
esac

check() {  # SUITE: installs and tracks; the digests of the trajectories are in ROOTS/SUITE.digests
  local root=$roots/$1 recording version given=()
  make_root "$1" "$root" python3 python3-venv
  if inside "$root" sh -c 'command -v cc || command -v gcc || command -v c++ || command -v clang'; then
    echo "check_wheel_root.sh: $root has a compiler" >&2
    exit 2
  fi
  mkdir -p "$root/check/recordings" "$root/check/wheels"
  cp check_installed.py "$root/check/"
  cp "$wheels"/*"_$machine.whl" "$root/check/wheels/"
  for recording in ${recordings[@]+"${recordings[@]}"}; do
    cp -r "$recording" "$root/check/recordings/"
    given+=("/check/recordings/$(basename "$recording")")
  done
  version=$(inside "$root" python3 -c 'import sys; print("%d.%d" % sys.version_info[:2])')
  python3 -m pip download -q --no-deps --only-binary :all: --python-version "$version" \
    --platform "manylinux_2_28_$machine" --platform "manylinux2014_$machine" --dest "$root/check/wheels" numpy
  inside "$root" python3 -m venv /check/env
  inside "$root" /check/env/bin/pip install -q --no-index --find-links /check/wheels kys-slam
  echo "$1: Python $version, $(inside "$root" ldd --version | head -1)"
  inside "$root" /check/env/bin/kys-slam demo
  inside "$root" sh -c 'cd /check && exec env/bin/python check_installed.py work "$@"' sh \
    ${given[@]+"${given[@]}"} | tee "$root/check/out"
  sed -n 's/^trajectory //p' "$root/check/out" >"$roots/$1.digests"
  [ -s "$roots/$1.digests" ]
}

first=
for suite in ${SUITES:-bookworm trixie}; do
  check "$suite"
  first=${first:-$suite}
  if ! cmp -s "$roots/$first.digests" "$roots/$suite.digests"; then
    echo "check_wheel_root.sh: other trajectories on $suite than on $first" >&2
    exit 1
  fi
done
if [ -n "$expected" ] && ! cmp -s "$expected" "$roots/$first.digests"; then
  echo "check_wheel_root.sh: other trajectories on $ARCHITECTURE than in $expected" >&2
  exit 1
fi
echo "the wheels run on: ${SUITES:-bookworm trixie} ($ARCHITECTURE)"
