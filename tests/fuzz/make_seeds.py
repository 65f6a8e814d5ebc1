#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Makes the seeds of the fuzz targets anew (they are in the tree): a few small sound files per reader.
Needs NumPy and Pillow.

    make_seeds.py BIN_DIR
"""
import io
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import zlib

import numpy as np
from PIL import Image

HERE = os.path.dirname(os.path.abspath(__file__))
TREE = os.path.join(HERE, "..", "..")
sys.path.insert(0, os.path.join(TREE, "python", "kys_slam"))
import kysp  # noqa: E402


def save(reader, name, data):
    folder = os.path.join(HERE, "seeds", reader)
    os.makedirs(folder, exist_ok=True)
    with open(os.path.join(folder, name), "wb") as file:
        file.write(data if isinstance(data, bytes) else data.encode())


def image_bytes(image, kind, **options):
    out = io.BytesIO()
    image.save(out, kind, **options)
    return out.getvalue()


def png(rows, depth, colour, channels=1):
    """A PNG of a kind Pillow does not write; rows of bytes."""
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    width = len(rows[0]) * 8 // (depth * channels)
    return (b"\x89PNG\r\n\x1a\n" +
            chunk(b"IHDR", struct.pack(">IIBBBBB", width, len(rows), depth, colour, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(b"".join(b"\1" + bytes(r) for r in rows))) +
            chunk(b"IEND", b""))


def images():
    grey = np.add.outer(np.arange(16) * 9, np.arange(24) * 5).astype(np.uint8)
    colour = np.stack([grey, grey[::-1], 255 - grey], axis=2)
    save("png", "grey.png", image_bytes(Image.fromarray(grey), "PNG"))
    save("png", "colour.png", image_bytes(Image.fromarray(colour), "PNG"))
    save("png", "alpha.png", image_bytes(Image.fromarray(colour).convert("RGBA"), "PNG"))
    save("png", "palette.png", image_bytes(Image.fromarray(colour).quantize(7), "PNG"))
    save("png", "grey16.png", image_bytes(Image.fromarray(grey.astype(np.uint16) * 257), "PNG"))
    save("png", "one_bit.png", png([bytes([y * 37 % 256] * 3) for y in range(16)], 1, 0))
    save("png", "colour16.png", png([bytes(range(y, y + 24)) for y in range(8)], 16, 2, 3))
    save("jpeg", "grey.jpg", image_bytes(Image.fromarray(grey), "JPEG", quality=60))
    save("jpeg", "colour.jpg", image_bytes(Image.fromarray(colour), "JPEG", quality=60))
    save("jpeg", "progressive.jpg",
         image_bytes(Image.fromarray(colour), "JPEG", quality=60, progressive=True))
    save("pnm", "grey.pgm", image_bytes(Image.fromarray(grey), "PPM"))
    save("pnm", "colour.ppm", image_bytes(Image.fromarray(colour), "PPM"))
    save("pnm", "grey16.pgm", b"P5\n# 12 bits\n24 16\n4095\n" +
         (grey.astype(">u2") * 16).tobytes())
    ids = np.zeros((16, 24, 3), np.uint8)
    ids[:, 8:16, 0], ids[:, 16:, 0] = 1, 2
    save("segmentation", "coco.png", image_bytes(Image.fromarray(ids), "PNG"))
    save("segmentation", "two_channel.png",
         image_bytes(Image.fromarray(np.where(ids > 0, [3, 1, 0], 0).astype(np.uint8)), "PNG"))
    save("segmentation", "classes.png", image_bytes(Image.fromarray(ids[:, :, 0] * 3), "PNG"))


def calibrations():
    save("kitti_calib", "odometry.txt", "P0: 40 0 24 0 0 40 16 0 0 0 1 0\n"
         "P1: 40 0 24 -20 0 40 16 0 0 0 1 0\n")
    save("kitti_calib", "colour.txt", "".join(
        f"P{k}: 4.0e+01 0 24 {x} 0 4.0e+01 16 0 0 0 1 0\n" for k, x in enumerate((0, -20, 2, -18))))
    save("kitti_times", "times.txt", "0.000000e+00\n1.036224e-01\n")
    save("euroc_data", "data.csv",
         "#timestamp [ns],filename\n1000000000,1.png\n2000000000,2.png\r\n")
    save("sensor_yaml", "euroc.yaml", """# General
sensor_type: camera
comment: VI-Sensor cam0 (MT9M034)
T_BS:
  cols: 4
  rows: 4
  data: [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975,
         0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768,
        -0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375]
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
""")
    camera = "{width: 48, height: 32, fx: 40, fy: 40, cx: 24, cy: 16, model: %s, distortion: %s}"
    matrix = "[1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]"
    for model in ("radtan", "equidistant"):
        text = camera % (model, "[-0.2, 0.05, 0.001, 0.0]")
        save("rig", f"own_{model}.yaml", f"left: {text}\nright: {text}\nT_left_right: {matrix}\n")
    save("rig", "orb_slam3.yaml", "%YAML:1.0\nCamera.type: \"PinHole\"\nCamera1.fx: 458.6\nCamera1.fy: 457.2\n"
         "Camera1.cx: 367.2\nCamera1.cy: 248.3\nCamera1.k1: -0.28\nCamera1.k2: 0.07\nCamera1.p1: 0.0\nCamera1.p2: 0.0\n"
         "Camera2.fx: 457.5\nCamera2.fy: 456.1\nCamera2.cx: 379.9\nCamera2.cy: 255.2\nCamera2.k1: -0.28\n"
         "Camera2.k2: 0.07\nCamera2.p1: 0.0\nCamera2.p2: 0.0\nCamera.width: 752\nCamera.height: 480\n"
         "Stereo.T_c1_c2: !!opencv-matrix\n  rows: 4\n  cols: 4\n  dt: f\n"
         "  data: [1, 0, 0, 0.11, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n")
    save("rig", "orb_slam2.yaml", "%YAML:1.0\nCamera.fx: 700\nCamera.fy: 700\nCamera.cx: 370\nCamera.cy: 240\n"
         "Camera.bf: 350\nCamera.width: 752\nCamera.height: 480\n")
    save("rig", "kalibr.yaml", "".join(f"""cam{k}:
  camera_model: pinhole
  distortion_coeffs: [-0.2, 0.05, 0.001, 0.0]
  distortion_model: radtan
  intrinsics: [40, 40, 24, 16]
  resolution: [48, 32]
""" + ("" if k == 0 else """  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.5]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
""") for k in (0, 1)))
    m = "!!opencv-matrix\n   rows: %d\n   cols: %d\n   dt: d\n   data: %s\n"
    k = m % (3, 3, "[40., 0., 24., 0., 40., 16., 0., 0., 1.]")
    d = m % (1, 5, "[-0.2, 0.05, 0., 0., 0.]")
    save("rig", "opencv.yaml", f"%YAML:1.0\n---\nimage_size: [48, 32]\nM1: {k}D1: {d}M2: {k}D2: {d}"
         f"R: {m % (3, 3, '[1., 0., 0., 0., 1., 0., 0., 0., 1.]')}"
         f"T: {m % (3, 1, '[-0.5, 0., 0.]')}")


def trajectories():
    rows = "".join(f"1 0 0 {0.1 * i:.6f} 0 1 0 0 0 0 1 {i:.6e}\n" for i in range(4))
    save("kitti_poses", "poses.txt", rows)
    save("tum_poses", "poses.tum", "# timestamp tx ty tz qx qy qz qw\n" + "".join(
        f"{10 + 0.1 * i:.9f} {i} 0 0.5 0 0 0 1\n" for i in range(4)))
    save("tum_poses", "repeated.tum", "1 0 0 0 0 0 0 1\n1 0 0 0 0.1 0 0 0.994987437\n")
    save("euroc_poses", "data.csv", "#timestamp,p_x,p_y,p_z,q_w,q_x,q_y,q_z,v_x\n" + "".join(
        f"{1403636580838555648 + i * 5000000},4.68,-1.78,0.78,0.534,-0.153,-0.827,-0.082,0.1\n"
        for i in range(4)))
    save("config", "some.yaml", "orb:\n  features: 1500  # per image\n  levels: 8\nkys:\n  mode: kys\n"
         "  alpha: 0.5\nloop: {enabled: false, candidates: 3}\ncontrol:\n"
         "  label_space: 'coco_panoptic_133'\n")
    save("config", "empty.yaml", "")
    data = os.path.join(TREE, "kys", "data")
    parts = []
    for part in ("classes", "table"):
        with open(os.path.join(data, f"vkitti2.{part}.csv"), "rb") as file:
            parts.append(file.read())
    save("label_space", "vkitti2", b"====\n".join(parts))


def objects():
    save("tracking_calib", "0000.txt", "P0: 40 0 24 0 0 40 16 0 0 0 1 0\n"
         "P2: 40 0 24 2 0 40 16 0 0 0 1 0\nP3: 40 0 24 -18 0 40 16 0 0 0 1 0\n"
         "R_rect 1 0 0 0 1 0 0 0 1\nTr_velo_cam 0 -1 0 0 0 0 -1 -0.1 1 0 0 -0.3\n"
         "Tr_imu_velo 1 0 0 -0.8 0 1 0 0.3 0 0 1 -0.8\n")
    save("tracking_oxts", "0000.txt", "".join(
        f"49.0{i} 8.4300001 112.83 0.022 0.011 -1.93 {'0 ' * 24}\n" for i in range(2)))
    save("vkitti_intrinsic", "intrinsic.txt", "frame cameraID K[0,0] K[1,1] K[0,2] K[1,2]\n" + "".join(
        f"{i} {c} 40.0 40.0 24 16\n" for i in range(2) for c in range(2)))
    save("vkitti_extrinsic", "extrinsic.txt", "frame cameraID r1,1 r1,2 r1,3 t1 r2,1 r2,2 r2,3 t2 r3,1 "
         "r3,2 r3,3 t3 0 0 0 1\n" + "".join(f"{i} {c} 1 0 0 {-0.5 * c} 0 1 0 0 0 0 1 {-i} 0 0 0 1\n"
                                            for i in range(2) for c in range(2)))
    save("true_objects", "labels.txt", "0 -1 DontCare -1 -1 -10 10 5 20 15 -1000 -1000 -1000 -10 -1 -1 "
         "-1\n" + "".join(f"{i} 4 Car 0 0 -1.7 10 5 20 15 1.5 1.6 4.0 -2.5 1.7 {15 - i} -1.6\n"
                         for i in range(3)))
    save("true_objects", "simulator.csv", "frame,timestamp,object,class,category_id,moving,x,y,z,qx,qy,qz,"
         "qw,vx,vy,vz,box_x,box_y,box_z,length,width,height,left_id,left_pixels,right_id,right_pixels\n" +
         "".join(f"{i},{0.1 * i:.9f},246,traffic light,6,1,0.006,1.62,{27 + i}.0,-0.5,0.5,-0.5,-0.5,0,"
                 f"-0.0045,3.38,0.0225,0,1.6,11.0,2.57,3.38,2445643,344,7508479,346\n"
                 for i in range(3)))
    save("true_objects", "pose.txt", "frame cameraID trackID alpha width height length world_space_X "
         "world_space_Y world_space_Z rotation_world_space_y rotation_world_space_x "
         "rotation_world_space_z camera_space_X camera_space_Y camera_space_Z rotation_camera_space_y "
         "rotation_camera_space_x rotation_camera_space_z\n" + "".join(
             f"{i} {c} 3 1.5 1.8 1.5 4.3 0 0 0 0 0 0 -5 1.6 {20 - i} -1.5 0 0\n"
             for i in range(3) for c in range(2)))
    save("vkitti_boxes", "bbox.txt", "frame cameraID trackID left right top bottom number_pixels "
         "truncation_ratio occupancy_ratio isMoving\n" + "".join(
             f"{i} {c} 3 10 20 5 15 88 0.0 0.9 {'True' if i else 'False'}\n"
             for i in range(2) for c in range(2)))
    save("run_objects", "objects.csv", "frame,name,timestamp,instance,class,p_moving,keypoints,x,y,z,vx,vy,"
         "vz,sigma_v\n" + "".join(f"{i},00000{i},{0.1 * i:.1f},7,traffic light,0.9,12,1,0,8,0,0,1.2,0.1\n"
                                 for i in range(3)))
    save("run_frames", "frames.csv", "index,name,timestamp,status,submap,reason\n" + "".join(
        f"{i},a{i},{0.1 * i:.1f},tracked,0\n" for i in range(3)))


def perception():
    save("coco_json", "segments.json", '{"annotations": [{"file_name": "a.png", "segments_info": ['
         '{"id": 1, "category_id": 3, "isthing": 1, "area": 128, "bbox": [8, 0, 8, 16]}, '
         '{"id": 2, "category_id": 149, "isthing": 0}]}], "categories": '
         '[{"id": 3, "isthing": 1, "name": "car"}, {"id": 149, "isthing": 0, "name": "road"}]}')
    save("coco_json", "nested.json", '{"annotations": ' + "[" * 70 + "]" * 70 + "}\n")
    save("coco_json", "large_number.json", '{"annotations": [{"file_name": "a.png", "segments_info": ['
         '{"id": 1, "category_id": ' + 60 * "1" + '}]}]}')
    disparity = np.linspace(0, 20, 12 * 8, dtype=np.float32).reshape(8, 12)
    flow = np.stack([disparity - 5, 3 - disparity], axis=2)
    out = io.BytesIO()
    np.save(out, disparity)
    save("field", "disparity.npy", b"\2" + out.getvalue())
    for name, array in (("flow_hw2", flow), ("flow_2hw", np.moveaxis(flow, 2, 0))):
        out = io.BytesIO()
        np.save(out, np.ascontiguousarray(array))
        save("field", name + ".npy", b"\2" + out.getvalue())
    save("field", "disparity.pfm", b"\1Pf\n12 8\n-1.0\n" + disparity[::-1].tobytes())
    save("field", "flow.flo", b"\3PIEH" + struct.pack("<ii", 12, 8) + flow.tobytes())
    save("field", "flow_large_header.flo", b"\3PIEH" + struct.pack("<ii", 2048, 15616) + bytes(24))
    save("field", "disparity.png",
         b"\0" + image_bytes(Image.fromarray((disparity * 256).astype(np.uint16)), "PNG"))
    rows = [b"".join(struct.pack(">HHH", 32768 + 64 * x, 32768 - 64 * y, 1) for x in range(12))
            for y in range(8)]
    save("field", "flow.png", b"\0" + png(rows, 16, 2, 3))


def own_formats(programs):
    frame = kysp.Frame("coco_panoptic_133", [], 1, 2, True)
    random = np.random.default_rng(3)
    for c in range(2):
        segments = np.zeros(4, kysp.SEGMENT)
        segments["label"], segments["flags"] = [100, 2, 2, 7], [0, 1, 3, 7]
        segments["instance"] = np.arange(4) + c * kysp.RIGHT_INSTANCES
        segments["scale"], segments["score"] = [1e4, 300, 0, 12.5], [0, 0, 55, 3]
        segment_map = np.repeat(random.integers(0, 5, (7, 5)), 6, axis=1).astype(np.uint16)
        frame.cameras.append(kysp.Camera(segments, segment_map, kysp.MOTION[np.repeat(
            random.integers(0, 256, (7, 10)), 3, axis=1)]))
    save("prior_file", "two_cameras.kysp", kysp.encode(frame))
    frame.cameras.pop()
    save("prior_file", "one_camera.kysp", kysp.encode(frame))
    with open(os.path.join(TREE, "tests", "map_file", "data", "version_1.map"), "rb") as file:
        save("map", "version_1.map", file.read())
    with tempfile.TemporaryDirectory() as folder:
        poses, path = os.path.join(folder, "poses.txt"), os.path.join(folder, "a.features")
        with open(poses, "w", encoding="ascii") as file:
            file.writelines(f"1 0 0 0 0 1 0 0 0 0 1 {0.5 * i}\n" for i in range(2))
        for version, options in ((1, []), (2, ["--traffic", "light", "--perception", "exact"])):
            subprocess.run([os.path.join(programs, "simulate_features"), poses, "--output", path,
                            "--features", "50", "--width", "200", "--far", "12", "--quiet",
                            *options], check=True, stdout=subprocess.DEVNULL)
            with open(path, "rb") as file:
                data = file.read()
            if len(data) < 60000:
                save("feature_file", f"version_{version}.features", data)
            if version == 2:
                payloads(data)


def payloads(data):
    count, = struct.unpack_from("<Q", data, 80)
    size, = struct.unpack_from("<Q", data, 124)
    at = 144 + 64 * count + 4
    truth = zlib.decompress(data[at:at + size - 4], wbits=-15)
    if len(truth) < 60000:
        save("feature_payload", "truth", b"\1" + truth)
    at += size
    length, = struct.unpack_from("<I", data, at + 4)
    frame = zlib.decompress(data[at + 16:at + 12 + length], wbits=-15)
    save("feature_payload", "frame", b"\0" + frame)
    save("feature_payload", "deflated", b"\2" + data[at + 16:at + 12 + length])


def clouds():
    columns = ("element vertex 2\nproperty float x\nproperty double y\nproperty float z\nproperty float nx\n"
               "property float ny\nproperty float nz\nproperty int class\nend_header\n")
    for order, name in (("<", "little"), (">", "big")):
        points = b"".join(struct.pack(order + "fdffffi", x, 2 * x, 3 * x, 0, 1, 0, 7) for x in (1.5, -2))
        save("point_cloud", f"{name}.ply", f"ply\nformat binary_{name}_endian 1.0\ncomment class 7 car\n".encode()
             + columns.encode() + points)
    save("point_cloud", "ascii.ply", "ply\nformat ascii 1.0\n" + columns + "1 2 3 0 1 0 7\n-1 nan 3 0 0 0 -1\n")
    head = ("# .PCD v0.7\nVERSION 0.7\nFIELDS x y z label\nSIZE 4 4 4 2\nTYPE F F F U\nCOUNT 1 1 1 2\nWIDTH 2\n"
            "HEIGHT 1\nPOINTS 2\nDATA ")
    save("point_cloud", "ascii.pcd", head + "ascii\n1 2 3 4 5\nnan nan nan 0 0\n")
    save("point_cloud", "binary.pcd", head.encode() + b"binary\n"
         + b"".join(struct.pack("<fffHH", x, x, x, 1, 2) for x in (1, 2)))
    packed = b"\x0f" + struct.pack("<ffff", 1, 2, 1, 2) + b"\xe0\x07\x03"  # a literal run, a copy of itself
    save("point_cloud", "compressed.pcd", head.encode() + b"binary_compressed\n"
         + struct.pack("<II", len(packed), 32) + packed)
    save("point_cloud", "points.xyz", "# x y z\n1, 2, 3, 4\n-1e2 0.5 7\n")


def main():
    shutil.rmtree(os.path.join(HERE, "seeds"), ignore_errors=True)
    images()
    calibrations()
    trajectories()
    objects()
    perception()
    clouds()
    own_formats(sys.argv[1])


if __name__ == "__main__":
    main()
