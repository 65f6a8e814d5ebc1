#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Sets everything up, builds, and runs the tests.
#   tools/test.sh [PRESET [CMAKE OPTION...]]     default release; others: debug, native
set -euo pipefail
cd "$(dirname "$0")/.."
preset=${1:-release}

tools/setup.sh --experiments
tools/setup.sh --python
cmake --preset "$preset" -DPython3_EXECUTABLE="$PWD/.venv/bin/python" "${@:2}"
cmake --build --preset "$preset"
ctest --preset "$preset" -j "$(nproc)"
