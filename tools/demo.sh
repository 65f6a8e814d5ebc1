#!/usr/bin/env bash
# Sets everything up, renders a simulated street, tracks it, and draws the result.
#   tools/demo.sh [FRAMES]     default 60
set -euo pipefail
cd "$(dirname "$0")/.."
frames=${1:-60}

tools/setup.sh --plots
cmake --preset release
cmake --build --preset release --target simulate_sequence run_stereo_kitti

world=runs/worlds/street-$frames
if [ ! -d "$world" ]; then
  build/release/bin/simulate_sequence street --size 620x188 --frames "$frames" --output "$world"
fi
build/release/bin/run_stereo_kitti "$world" --output runs/demo
.venv/bin/python tools/plots/plot_trajectory.py runs/demo
echo
echo "the frames are in $world/image_0, the table above and the pictures in runs/demo:"
ls runs/demo/*.png
