#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Every table and figure of the paper, with the published figures beside: sets up, builds, runs the
# experiments of configs/experiments, and writes a report. What was done before is not done again;
# interrupt it (Ctrl-C) and call it again as you like.
#   tools/reproduce.sh [--data ROOT] [--quick] [--miniature] [--cores N] [--profile NAME] [--output DIR]
#                      [--worlds DIR] [--bin DIR] [--dry-run]
#                      [--segment-model YAML [--segment-weights FILE] [--stereo-model YAML] [--flow-model YAML]]
#                      [--only NAME...] [--seeds N...] [--inputs NAME...] [--schedules NAME...]
#                      [--pages] [--no-setup]
#   --data ROOT     folder that holds KITTI odometry, KITTI Tracking, EuRoC, Virtual KITTI 2 or some
#                   of them, anywhere in it; what is not there is simulated, and marked so
#                   (complete: about 14 hours of two cores, 9 with --schedules pipelined; times by --dry-run)
#   --segment-model YAML  a segmentation network (tools/perception/README.md): perception of KITTI odometry
#                   becomes jobs; without it recordings without prior files run without priors only
#   --segment-weights FILE  its ONNX file, if the YAML file does not name it
#   --stereo-model YAML, --flow-model YAML  networks instead of SGBM and DIS (--stereo-weights, --flow-weights)
#   --quick         short sequences, one or two seeds: about 40 minutes of two cores
#   --miniature     two sequences of 16 frames, two modes: whether it all works
#   --profile NAME  where jobs run: local (default), slurm, kubernetes, or a folder with a profile
#   --output DIR    default runs/reproduce, runs/reproduce-quick
#   --only NAME...  experiments by name (table_1_kitti, study_priors ...)
#   --schedules NAME...  only runs of these schedules; realtime runs take hours
#   --worlds DIR    simulated worlds rendered before, taken where the command in their README fits
#   --bin DIR       programs that are built already
#   --pages         puts the tables into the pages of docs/results
#   --no-setup      nothing is installed or built
#   --dry-run       say what would be done, and how long it is expected to take
set -euo pipefail

scale=full cores=$(nproc) profile=local output="" setup=true networks=false dry="" pages=false bin=build/release/bin
python=${KYS_PYTHON:-.venv/bin/python}
# Paths are the caller's: they are read before the folder changes.
path() { realpath -m -- "$1"; }
case ${KYS_PYTHON:-} in */*) python=$(realpath -ms -- "$KYS_PYTHON") ;; esac  # a link stays one
plan=()
while [ $# -gt 0 ]; do
  case $1 in
    --quick) scale=quick; shift ;;
    --miniature) scale=miniature; shift ;;
    --cores) cores=${2:?--cores N}; shift 2 ;;
    --profile) profile=${2:?--profile NAME}; shift 2 ;;
    --output) output=$(path "${2:?--output DIR}"); shift 2 ;;
    --bin) bin=$(path "${2:?--bin DIR}"); shift 2 ;;
    --worlds) plan+=(--worlds "$(path "${2:?--worlds DIR}")"); shift 2 ;;
    --data) plan+=(--data "$(path "${2:?--data ROOT}")"); shift 2 ;;
    --segment-model | --segment-weights | --stereo-model | --stereo-weights | --flow-model | --flow-weights)
      plan+=("$1" "$(path "${2:?$1 FILE}")"); networks=true; shift 2 ;;
    --pages) pages=true; shift ;;
    --no-setup) setup=false; shift ;;
    --dry-run) dry=--dry-run; shift ;;
    --only | --seeds | --inputs | --schedules)
      plan+=("$1"); shift
      while [ $# -gt 0 ] && [ "${1#--}" = "$1" ]; do plan+=("$1"); shift; done ;;
    -h | --help) sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0"; exit 0 ;;
    *) echo "tools/reproduce.sh: unknown option $1; see --help" >&2; exit 2 ;;
  esac
done
[ ! -d "$profile" ] || profile=$(path "$profile")
cd "$(dirname "$0")/.."
if [ -z "$output" ]; then
  output=runs/reproduce
  [ "$scale" = full ] || output=$output-$scale
fi
[ -d "$profile" ] || profile=tools/experiments/profiles/$profile
[ -d "$profile" ] || { echo "tools/reproduce.sh: $profile: no such profile" >&2; exit 2; }

if $setup; then
  tools/setup.sh --experiments
  ! $networks || tools/setup.sh --onnx
  cmake --preset release -DPython3_EXECUTABLE="$PWD/.venv/bin/python" >/dev/null
  cmake --build --preset release --target simulate_sequence simulate_features build_priors \
    perturb_priors compare_priors run_stereo_kitti run_stereo_euroc kys_slam_core
fi

mkdir -p "$output"
exec 9>"$output/.lock"
flock -n 9 || { echo "tools/reproduce.sh: another one is at work in $output" >&2; exit 2; }
"$python" tools/experiments/plan.py --output "$output" --scale "$scale" --cores "$cores" \
  --bin "$bin" "${plan[@]}"
status=0
if [ -n "$dry" ]; then  # thousands of lines
  exec >"$output/dry-run.txt"
  echo "reproduce.sh: the jobs are listed in $output/dry-run.txt" >&2
fi
"$python" -m snakemake --snakefile tools/experiments/Snakefile --directory "$output" \
  --profile "$profile" --cores "$cores" --nolock --rerun-incomplete --rerun-triggers mtime \
  --keep-going --quiet all $dry || status=$?
[ -z "$dry" ] || exit "$status"
[ "$status" -lt 128 ] || exit "$status"
"$python" tools/experiments/report.py "$output"
! $pages || "$python" tools/experiments/pages.py "$output" docs/results/*.md
exit "$status"
