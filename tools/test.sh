#!/usr/bin/env bash
# Sets everything up, builds with warnings as errors, and runs the tests.
#   tools/test.sh [PRESET]     default release; others: debug, asan, tsan, native
set -euo pipefail
cd "$(dirname "$0")/.."
preset=${1:-release}

tools/setup.sh --plots
cmake --preset "$preset" -DKYS_WARNINGS_AS_ERRORS=ON -DPython3_EXECUTABLE="$PWD/.venv/bin/python"
cmake --build --preset "$preset"
ctest --preset "$preset" -j "$(nproc)"
