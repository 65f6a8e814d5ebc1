#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Wheels that install on other machines: built from this tree, the shared libraries they link copied into
# them (auditwheel), with a list of these and their licences (packaging/sbom.py).
#   packaging/make_wheel.sh OUTPUT [PYTHON...]     by default python3
# The tag is the oldest manylinux that the symbols allow. One PYTHON of 3.12 or later makes the wheel for all of
# these; an earlier one makes its own. Needs its headers and venv.
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
if [ $# -eq 0 ]; then set -- python3; fi
mkdir -p "$output"

for python in "$@"; do
  tag=$(python_tag "$python")
  env=$(build_env "$python")
  work=build/wheels/$tag
  rm -rf "$work"
  mkdir -p "$work"
  PATH=$env/bin:$PATH pip wheel -q . --no-deps --no-build-isolation \
    --config-settings=build-dir="build/wheel-$tag" --wheel-dir "$work/raw"
  PATH=$env/bin:$PATH auditwheel repair --wheel-dir "$work/repaired" "$work"/raw/*.whl
  "$env/bin/python" packaging/sbom.py wheel "$work"/repaired/*.whl
  cp "$work"/repaired/*.whl "$output/"
done
ls -l "$output"/*.whl
