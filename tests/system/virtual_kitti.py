#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Converts a sequence of simulate_sequence (KITTI layout, with its ground truth) to Virtual KITTI 2.

    virtual_kitti.py WORLD FOLDER            FOLDER becomes SceneXX/VARIATION: frames/, *.txt

What the simulator does not know is left out, never made up: backward flow, and the tables of boxes
and models (bbox.txt, pose.txt, info.txt). Needs NumPy and Pillow.
"""
import csv
import json
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
from PIL import Image

CAMERAS = ((0, "left"), (1, "right"))
COLOURS = {  # colors.txt
    "Terrain": (210, 0, 200), "Sky": (90, 200, 255), "Tree": (0, 199, 0),
    "Vegetation": (90, 240, 0), "Building": (140, 140, 140), "Road": (100, 60, 100),
    "GuardRail": (250, 100, 255), "TrafficSign": (255, 255, 0), "TrafficLight": (200, 200, 0),
    "Pole": (255, 130, 0), "Misc": (80, 80, 80), "Truck": (160, 60, 60), "Car": (255, 127, 80),
    "Van": (0, 139, 139), "Undefined": (0, 0, 0)}
VEHICLES = ("Truck", "Car", "Van")
# By COCO category. There are no people in Virtual KITTI, and no buses: a van is the third vehicle.
CLASS_OF = {0: "Undefined", 1: "Undefined", 3: "Car", 6: "Van", 8: "Truck", 10: "TrafficLight",
            15: "Misc",
            64: "Vegetation", 149: "Road", 184: "Tree", 185: "GuardRail", 187: "Sky",
            191: "Terrain", 197: "Building"}
SKY_DEPTH = 65535  # cm
# Where a scene's world begins is anybody's guess; here its axes are turned and far from the car.
WORLD_TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
WORLD_ORIGIN = np.array([141.37, -3.21, -95.83])  # m


def read_png(path):
    """Pixels of an 8- or 16-bit grey or RGB PNG as the simulator writes them: Pillow drops the low
    bytes of 16-bit colour."""
    data, at, packed = Path(path).read_bytes(), 8, b""
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 8:at + 8 + length]
        if kind == b"IHDR":
            width, height, bits, colour = struct.unpack_from(">IIBB", body)
        elif kind == b"IDAT":
            packed += body
        at += 12 + length
    channels = {0: 1, 2: 3}[colour]
    pixel = channels * bits // 8
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + width * pixel)
    out = np.zeros((height, width * pixel), np.uint8)
    for y in range(height):
        if rows[y, 0] > 2:
            raise ValueError(f"{path}: only the filters none, sub and up are read here")
        out[y] = rows[y, 1:]
        if rows[y, 0] == 1:
            out[y] = np.cumsum(out[y].reshape(width, pixel), axis=0, dtype=np.uint8).ravel()
        elif rows[y, 0] == 2 and y > 0:
            out[y] += out[y - 1]
    return out.view(f">u{bits // 8}").reshape(height, width, channels).squeeze()


def write_png16(path, pixels):
    """A 16-bit grey or RGB PNG."""
    height, width = pixels.shape[:2]
    body = np.ascontiguousarray(pixels, ">u2").view(np.uint8).reshape(height, -1)
    rows = np.hstack([np.zeros((height, 1), np.uint8), body]).tobytes()

    def chunk(kind, content):
        return (struct.pack(">I", len(content)) + kind + content
                + struct.pack(">I", zlib.crc32(kind + content)))

    header = struct.pack(">IIBBBBB", width, height, 16, 2 if pixels.ndim == 3 else 0, 0, 0, 0)
    Path(path).write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)
                           + chunk(b"IDAT", zlib.compress(rows, 1)) + chunk(b"IEND", b""))


class World:
    """A simulated sequence: calibration, poses, and what every segment is."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.names = sorted(f.stem for f in (self.folder / "image_0").glob("*.png"))
        rows = [line.split() for line in (self.folder / "calib.txt").read_text().splitlines()]
        left, right = (np.array(row[1:], float) for row in rows[:2])
        self.fx, self.fy, self.cx, self.cy = left[[0, 5, 2, 6]]
        self.baseline = -right[3] / self.fx
        self.poses = np.loadtxt(self.folder / "poses.txt").reshape(-1, 3, 4)  # T_w_c, left
        with open(self.folder / "ground_truth.csv", newline="", encoding="utf-8") as file:
            truth = list(csv.DictReader(file))
        # (frame, camera, segment) -> object, of vehicles only
        self.object_of = {(int(r["frame"]), r["camera"], int(r["segment_id"])): int(r["object"])
                          for r in truth if CLASS_OF[int(r["category_id"])] in VEHICLES}
        # instancegt holds trackID + 1
        self.instance_of = {o: i + 1 for i, o in enumerate(sorted(set(self.object_of.values())))}
        if len(self.instance_of) > 255:
            raise ValueError(f"{folder}: more vehicles than an instance picture can tell apart")
        self.categories = {}
        for camera in ("left", "right"):
            document = json.loads((self.folder / f"panoptic_{camera}.json").read_text())
            for a in document["annotations"]:
                self.categories[a["file_name"][:-4], camera] = {
                    s["id"]: s["category_id"] for s in a["segments_info"]}

    def picture(self, folder, name):
        return read_png(self.folder / folder / f"{name}.png")


def segmentations(world, name, camera):
    """Class names as indices into COLOURS, and instance indices."""
    rgb = world.picture(f"panoptic_{camera}", name).astype(np.uint32)
    ids, where = np.unique(rgb @ np.array([1, 256, 65536], np.uint32), return_inverse=True)
    categories = world.categories[name, camera]
    classes = [list(COLOURS).index(CLASS_OF[categories.get(int(i), 0)]) for i in ids]
    instances = [world.instance_of.get(world.object_of.get((int(name), camera, int(i))), 0)
                 for i in ids]
    shape = rgb.shape[:2]
    return (np.array(classes)[where].reshape(shape),
            np.array(instances, np.uint8)[where].reshape(shape))


def depth_picture(world, name, camera):
    """cm along the optical axis. No disparity (sky, or nearer than 0.75 m) becomes the sky."""
    disparity = world.picture("disparity" + ("_right" if camera == "right" else ""), name) / 256.0
    with np.errstate(divide="ignore"):
        depth = np.rint(100 * world.fx * world.baseline / disparity)
    return np.minimum(depth, SKY_DEPTH).astype(np.uint16)


def flow_picture(world, name, camera, sky):
    """-(w - 1)..w - 1 px as 0..65535, rows likewise; blue 0 where there is none, as in the sky."""
    stored = world.picture(f"flow_{camera}", name).astype(float)
    height, width = sky.shape
    flow = (stored[..., :2] - 32768) / 64
    coded = np.rint((flow / [width - 1, height - 1] + 1) / 2 * 65535)
    fits = ((coded >= 0) & (coded <= 65535)).all(axis=2)
    valid = (stored[..., 2] > 0) & fits & ~sky
    coded = np.dstack([coded, np.full(sky.shape, 65535)])
    return np.where(valid[..., None], coded, 0).astype(np.uint16)


def write_frame(world, name, folder, last):
    number = f"{int(name):05d}"
    colours = np.array(list(COLOURS.values()), np.uint8)
    palette = np.random.default_rng(1).integers(0, 256, 768).tolist()  # indices count, not colours
    for c, camera in CAMERAS:
        def path(kind, file, c=c):
            target = folder / "frames" / kind / f"Camera_{c}" / file
            target.parent.mkdir(parents=True, exist_ok=True)
            return target

        grey = Image.fromarray(world.picture(f"image_{c}", name))
        grey.convert("RGB").save(path("rgb", f"rgb_{number}.jpg"), quality=95)
        classes, instances = segmentations(world, name, camera)
        Image.fromarray(colours[classes]).save(path("classSegmentation", f"classgt_{number}.png"))
        indexed = Image.fromarray(instances).convert("P")
        indexed.putpalette(palette)
        indexed.save(path("instanceSegmentation", f"instancegt_{number}.png"))
        write_png16(path("depth", f"depth_{number}.png"), depth_picture(world, name, camera))
        if not last:
            sky = classes == list(COLOURS).index("Sky")
            write_png16(path("forwardFlow", f"flow_{number}.png"),
                        flow_picture(world, name, camera, sky))


def write_tables(world, folder):
    intrinsic = ["frame cameraID K[0,0] K[1,1] K[0,2] K[1,2]"]
    extrinsic = ["frame cameraID r1,1 r1,2 r1,3 t1 r2,1 r2,2 r2,3 t2 r3,1 r3,2 r3,3 t3 0 0 0 1"]

    def row(*numbers):  # single precision, as the originals
        return " ".join(f"{n:.7G}" for n in numbers)

    for i, pose in enumerate(world.poses):
        for c, _ in CAMERAS:
            intrinsic.append(row(i, c, world.fx, world.fy, world.cx, world.cy))
            turn = WORLD_TURN @ pose[:, :3]
            centre = WORLD_TURN @ (pose[:, 3] + c * world.baseline * pose[:, 0]) + WORLD_ORIGIN
            world_to_camera = np.column_stack([turn.T, -turn.T @ centre])
            extrinsic.append(row(i, c, *world_to_camera.ravel(), 0, 0, 0, 1))
    colours = ["Category r g b"] + [f"{n} {r} {g} {b}" for n, (r, g, b) in COLOURS.items()]
    for name, lines in (("intrinsic", intrinsic), ("extrinsic", extrinsic), ("colors", colours)):
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def convert(world, folder):
    for name in world.names:
        write_frame(world, name, Path(folder), name == world.names[-1])
    write_tables(world, Path(folder))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    convert(World(sys.argv[1]), sys.argv[2])
