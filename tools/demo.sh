#!/usr/bin/env bash
# Sets everything up, renders a simulated street with a lorry ahead and other traffic, makes priors
# from its exact perception, tracks it without and with them, and draws both. Then once around a
# block: a loop to close.
#   tools/demo.sh [FRAMES]     default 100
set -euo pipefail
cd "$(dirname "$0")/.."
frames=${1:-100}

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

for mode in stock kys; do
  echo
  echo "mode $mode"
  "$bin/run_stereo_kitti" "$world" --priors "$priors" --mode "$mode" --output "runs/demo-$mode"
  .venv/bin/python tools/plots/plot_trajectory.py "runs/demo-$mode"
done

block=runs/worlds/block
if [ ! -d "$block" ]; then
  "$bin/simulate_sequence" block --size 414x126 --images-only --output "$block"
fi
echo
echo "once around a block"
"$bin/run_stereo_kitti" "$block" --output runs/demo-block
.venv/bin/python tools/plots/plot_trajectory.py runs/demo-block
echo
echo "the frames are in $world/image_0, the pictures of the trajectories are"
ls runs/demo-*/*.png
