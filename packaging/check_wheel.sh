#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Does `pip install .` work for somebody new? A fresh clone of HEAD, a fresh virtual environment, the
# Python tests against what was installed.   packaging/check_wheel.sh [FOLDER]
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
work=$(realpath -m "${1:-$(mktemp -d)}")
git clone -q "$root" "$work/clone"
python3 -m venv "$work/env"
cd "$work/clone"
"$work/env/bin/pip" install '.[all,test]'
cd "$work"
"$work/env/bin/kys-slam" demo
KYS_BIN_DIR=${KYS_BIN_DIR:-$root/build/release/bin} \
KYS_WORLDS=${KYS_WORLDS:-$root/build/release/regression/data} \
KYS_SHARED_DATA_DIR=${KYS_SHARED_DATA_DIR:-$root/../shared/data} \
  "$work/env/bin/python" -m pytest -q -p no:cacheprovider clone/python/tests
