#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs what the project needs on Debian 12 or Ubuntu 24.04 (as root or with sudo), once.
#   tools/setup.sh            compiler, libraries, tests
#   tools/setup.sh --plots    the same, and a Python environment in .venv for the pictures
#   tools/setup.sh --experiments  and what the experiments need (tools/reproduce.sh)
#   tools/setup.sh --python   and what the Python package and its tests need in it
#   tools/setup.sh --format   and clang-format (tools/check.sh format)
#   tools/setup.sh --checks   and Clang, clang-format, clang-tidy (tools/check.sh, tools/lint.sh)
#   tools/setup.sh --browser  and Chromium, in which a test opens the report of the experiments
#   tools/setup.sh --site     and MkDocs in it (target site)
#   tools/setup.sh --view        the same, and Rerun, to see and record runs (0.6 GB)
#   tools/setup.sh --onnx        and what networks as ONNX files need in it (make_priors; 0.4 GB)
#   tools/setup.sh --perception   and the networks' libraries in it (tools/perception; 6 GB)
set -euo pipefail

packages=(
  build-essential cmake ninja-build ccache pkg-config git ca-certificates
  libeigen3-dev libopencv-dev libceres-dev libsuitesparse-dev libyaml-cpp-dev libcli11-dev
  libspdlog-dev libfmt-dev nlohmann-json3-dev libspng-dev libdeflate-dev libturbojpeg0-dev
  libdlib-dev libembree-dev libgtest-dev libbenchmark-dev doxygen python3 python3-venv python3-dev
)
if [ "$(dpkg --print-architecture)" = arm64 ]; then packages+=(libsimde-dev); fi
case "$#:${1:-}" in
  0: | 1:--plots | 1:--experiments | 1:--python | 1:--browser | 1:--site | 1:--view | 1:--onnx | \
    1:--perception) ;;
  1:--format) packages+=(clang-format) ;;
  1:--checks) packages+=(clang clang-format clang-tidy) ;;
  1:-h | 1:--help) sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0"; exit 0 ;;
  1:*) echo "tools/setup.sh: unknown option $1; see --help" >&2; exit 2 ;;
  *) echo "tools/setup.sh: one option at a time; see --help" >&2; exit 2 ;;
esac
cd "$(dirname "$0")/.."
as_root() { if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi; }

install() {  # those of the packages that are missing
  local missing=() package
  for package in "$@"; do
    dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' ||
      missing+=("$package")
  done
  if [ "${#missing[@]}" -eq 0 ]; then return; fi
  echo "installing: ${missing[*]}"
  as_root apt-get update -qq
  as_root env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
}
install "${packages[@]}"

make_environment() {  # a Python environment in .venv
  [ -x .venv/bin/pip ] && return
  echo "making a Python environment in .venv"
  /usr/bin/python3 -m venv .venv
}
install_python() { .venv/bin/pip install --quiet --disable-pip-version-check "$@"; }

case "${1:-}" in
  --plots)
    if ! .venv/bin/python -c 'import matplotlib' 2>/dev/null; then
      make_environment
      install_python numpy matplotlib
    fi
    ;;
  --experiments)
    if ! .venv/bin/python -c 'import matplotlib, nanobind, scipy, snakemake, yaml' 2>/dev/null; then
      make_environment
      install_python numpy matplotlib 'scipy>=1.15' 'snakemake>=8,<10' pyyaml nanobind
    fi
    ;;
  --python | --view)
    if ! .venv/bin/python -c 'import cv2, evo, foxglove_schemas_protobuf, matplotlib, mcap_protobuf, nanobind, pytest, rosbags, scikit_build_core, shtab, yaml' 2>/dev/null; then
      make_environment
      install_python numpy matplotlib nanobind scikit-build-core pytest pyyaml \
        opencv-python-headless rosbags mcap-protobuf-support foxglove-schemas-protobuf evo shtab
    fi
    if [ "$1" = --view ]; then install_python rerun-sdk; fi
    ;;
  --checks)  # the sanitizers' libraries have Clang's version in their name
    version=$(clang -dumpversion)
    install "libclang-rt-${version%%.*}-dev"
    ;;
  --browser)
    type chromium >/dev/null 2>&1 || type google-chrome >/dev/null 2>&1 || install chromium
    ;;
  --site)
    make_environment
    install_python 'mkdocs>=1.6,<2'
    ;;
  --onnx)
    make_environment
    install_python numpy onnx onnxruntime opencv-python-headless pyyaml
    ;;
  --perception)
    make_environment
    install_python -r tools/perception/requirements.txt matplotlib
    ;;
esac
