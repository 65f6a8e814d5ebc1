#!/usr/bin/env bash
# Installs what is needed, renders a simulated street with a truck ahead and other traffic, makes priors
# from exact perception, and tracks the street three times: with the pose with most inlier matches, with
# the pose with most inlier image area, and with priors. Then it tracks a drive around a block, which
# ends in a loop. Plots all runs; results are in runs/demo-*.
#   tools/demo.sh [FRAMES]     default 100
set -euo pipefail
cd "$(dirname "$0")/.."
frames=${1:-100}
case $frames in
  -h | --help) sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "$0"; exit 0 ;;
  *[!0-9]* | '') echo "tools/demo.sh: FRAMES is a whole number; see --help" >&2; exit 2 ;;
esac

tools/setup.sh --plots
cmake --preset release
cmake --build --preset release --target simulate_sequence build_priors run_stereo_kitti

bin=build/release/bin
world=runs/worlds/street-$frames
priors=runs/worlds/street-$frames-priors
if [ ! -d "$world" ]; then
  "$bin/simulate_sequence" street --size 620x188 --frames "$frames" --output "$world"
fi
"$bin/build_priors" "$world" --output "$priors" \
  --panoptic-left "$world/panoptic_left" --panoptic-right "$world/panoptic_right" \
  --disparity "$world/disparity" --flow-left "$world/flow_left" --flow-right "$world/flow_right"

track() {  # name, then arguments
  echo
  echo "$1: ${*:2}"
  "$bin/run_stereo_kitti" "$world" --priors "$priors" --output "runs/demo-$1" --overwrite "${@:2}"
  .venv/bin/python tools/plots/plot_trajectory.py "runs/demo-$1"
}
track matches --mode stock --set tracking.balanced=false --set place.min_area=0
track area --mode stock
track priors --mode verified
.venv/bin/python tools/plots/compare_runs.py "runs/demo-matches=most matches" \
  "runs/demo-area=most image area" "runs/demo-priors=with priors" --output runs/demo-street.png

block=runs/worlds/block
if [ ! -d "$block" ]; then
  "$bin/simulate_sequence" block --size 414x126 --images-only --output "$block"
fi
echo
echo "once around a block"
"$bin/run_stereo_kitti" "$block" --output runs/demo-block --overwrite
.venv/bin/python tools/plots/plot_trajectory.py runs/demo-block
echo
echo "the frames are in $world/image_0, the pictures of the trajectories are"
ls runs/demo-*.png runs/demo-*/*.png
