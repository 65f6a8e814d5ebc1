# SPDX-License-Identifier: BSD-3-Clause
"""Shows the map of a run in Open3D, by class, without what may move: show_map.py RUN/map.ply"""

import sys

import kys_slam

MAY_MOVE = {"person", "bicycle", "car", "motorcycle", "bus", "truck"}


def main(path: str, picture: bool = True) -> None:
    landmarks = kys_slam.read_map(path)
    for label, name in landmarks.classes.items():
        print(f"{name:<24} {(landmarks.points['class'] == label).sum():6d} landmarks")

    import open3d  # pip install open3d-cpu

    cloud = open3d.t.io.read_point_cloud(path)
    mobile = [label for label, name in landmarks.classes.items() if name in MAY_MOVE]
    keep = (cloud.point["observations"] >= 3).flatten()
    for label in mobile:
        keep = keep.logical_and((cloud.point["class"] != label).flatten())
    cloud = cloud.select_by_mask(keep)
    print(f"{len(cloud.point.positions)} of {len(landmarks.points)} landmarks shown")
    if picture:
        open3d.visualization.draw_geometries([cloud.to_legacy()])


if __name__ == "__main__":
    main(sys.argv[1], "--no-window" not in sys.argv)
