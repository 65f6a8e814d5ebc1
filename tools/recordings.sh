#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Figures on the real recordings found in a folder, with digests of input and trajectory, as one table.
#   tools/recordings.sh [--data ROOT] [--bin DIR] [--output DIR] [--frames N] [--only NAME...]
#                       [--schedules NAME...] [--check TABLE.json] [--page PAGE.md] [--table TABLE.json]
#   --data ROOT     folder that holds KITTI odometry, KITTI raw, KITTI Tracking, EuRoC, TUM-VI, Virtual
#                   KITTI 2, pairs of image folders with a camchain.yaml, or excerpts of these, anywhere
#                   in it (default: KYS_SHARED_DATA_DIR, or ../shared/data)
#   --bin DIR       programs (default build/release/bin); the Python package is taken from DIR/../python
#   --output DIR    the runs, table.md, table.json (default runs/recordings)
#   --frames N      only the first N frames of each recording
#   --only NAME...  only recordings of these names
#   --check FILE    compares with a stored table: same, differs, or no such recording here
#   --page FILE     writes the table into this page, between its markers
#   --table FILE    writes table.json there as well
set -euo pipefail
source=$(cd "$(dirname "$0")/.." && pwd)
python=${KYS_PYTHON:-$source/.venv/bin/python}
case ${1:-} in -h | --help) sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0"; exit 0 ;; esac
exec "$python" "$source/tools/experiments/recordings.py" "$@"
