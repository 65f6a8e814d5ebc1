#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs what is needed, builds, and tracks two rendered worlds: a drive around a block, which ends in
# a loop, and a street full of moving traffic, once without priors and once with priors made from exact
# perception. Prints the position errors and draws pictures; everything is in runs/demo-*.
#   tools/demo.sh [FRAMES]     frames of the traffic, 30 to 200; default 60
set -euo pipefail
cd "$(dirname "$0")/.."
frames=${1:-60}
case $frames in
  -h | --help) sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0"; exit 0 ;;
  *[!0-9]* | '' | ????*) frames=0 ;;
esac
if [ "$frames" -lt 30 ] || [ "$frames" -gt 200 ]; then
  echo "tools/demo.sh: FRAMES is a whole number from 30 to 200; see --help" >&2
  exit 2
fi

tools/setup.sh --plots
cmake --preset release
cmake --build --preset release --target simulate_sequence build_priors validate_priors run_stereo_kitti

bin=build/release/bin
worlds=runs/worlds
render() {  # folder, then arguments: once
  [ -d "$worlds/$1" ] || "$bin/simulate_sequence" "${@:2}" --output "$worlds/$1"
}
track() {  # name of the run, world, then arguments
  echo "tracking: $bin/run_stereo_kitti $worlds/${*:2} --output runs/demo-$1"
  "$bin/run_stereo_kitti" "$worlds/$2" --output "runs/demo-$1" --overwrite --quiet "${@:3}"
}
plot() { .venv/bin/python "tools/plots/$1.py" "${@:2}"; }

render block block --size 414x126 --images-only
track block block

traffic=traffic-$frames
render "$traffic" traffic --size 620x188 --frames "$frames"
world=$worlds/$traffic
"$bin/build_priors" "$world" --output "$world-priors" \
  --panoptic-left "$world/panoptic_left" --panoptic-right "$world/panoptic_right" \
  --disparity "$world/disparity" --flow-left "$world/flow_left" --flow-right "$world/flow_right"
track without-priors "$traffic"
track with-priors "$traffic" --priors "$world-priors"

echo
plot plot_trajectory runs/demo-block
plot plot_trajectory runs/demo-with-priors
plot compare_runs "runs/demo-without-priors=without priors" "runs/demo-with-priors=with priors" \
  --image "$world/image_0/000025.png" --output runs/demo-traffic.png
.venv/bin/python - <<'SEEN'
import json


def seen(name):
    with open(f"runs/demo-{name}/summary.json", encoding="utf-8") as file:
        run = json.load(file)
    tracked, frames, path = run["frames_tracked"], run["frames"], run["path_length_m"]
    return (f"position error {run['ate_se3_rmse_m']:6.3f} m, path {path:5.1f} m, "
            f"{tracked} of {frames} frames tracked")


print(f"\nblock, where hardly anything moves, without priors:    {seen('block')}")
print(f"traffic, which fills most of the view, without priors: {seen('without-priors')}")
print(f"the same traffic, with priors:                         {seen('with-priors')}")
print("The error is the root mean square after alignment with the true path. Open runs/demo-traffic.png:\n"
      "without priors the camera seems to stand. What the files are: docs/reference.md")
SEEN
