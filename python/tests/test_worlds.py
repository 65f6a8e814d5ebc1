# SPDX-License-Identifier: BSD-3-Clause
"""Simulated worlds in every form a user may have them: bags, calibrations, lenses, masks.

The worlds are those of the regression suite: KYS_WORLDS is its folder of input.
"""

import json
import os
from pathlib import Path

import numpy as np
import pytest

import kys_slam
from bags import write_bag
from conftest import ROOT, run_program
from kys_slam import cli, recordings
from kys_slam.kysp import DYNAMIC

WORLDS = Path(os.environ.get("KYS_WORLDS", ROOT / "build/release/regression/data"))


def world(pattern):
    found = sorted(p for p in WORLDS.glob(pattern) if p.is_dir())
    if not found:
        pytest.skip(f"no {pattern} in {WORLDS}")
    return found[0]


@pytest.fixture(scope="module")
def hall():
    return world("hall-376x240-*-1-images")


@pytest.fixture(scope="module")
def hall_tum(hall, tmp_path_factory):
    folder = tmp_path_factory.mktemp("hall")
    run_program("run_stereo_euroc", hall, "--output", folder, "--quiet")
    return (folder / "trajectory.tum").read_bytes()


@pytest.fixture(scope="module")
def shots(hall):
    """[(stamp ns, left path, right path)]"""
    cams = [hall / "mav0" / cam / "data" for cam in ("cam0", "cam1")]
    return [(int(p.stem), p, cams[1] / p.name) for p in sorted(cams[0].glob("*.png"))]


class Rig:
    """A world's raw cameras, and its calibration in the formats of the field."""

    def __init__(self, folder):
        yaml = pytest.importorskip("yaml")
        self.K, self.D, poses = [], [], []
        for cam in ("cam0", "cam1"):
            text = (folder / "mav0" / cam / "sensor.yaml").read_text().replace("%YAML:1.0", "")
            d = yaml.safe_load(text)
            self.K.append(d["intrinsics"])
            self.D.append(d["distortion_coefficients"])
            self.size = d["resolution"]
            poses.append(np.array(d["T_BS"]["data"]).reshape(4, 4))
        self.T_body = poses[0]
        self.T = np.linalg.inv(poses[1]) @ poses[0]  # right camera from left camera

    def matrix(self, side):
        fx, fy, cx, cy = self.K[side]
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])

    def kalibr(self, path, lens="radtan", D=None):
        text = ""
        for i in range(2):
            text += (f"cam{i}:\n  camera_model: pinhole\n  distortion_model: {lens}\n"
                     f"  intrinsics: {self.K[i]}\n  distortion_coeffs: {list((D or self.D)[i])}\n"
                     f"  resolution: {self.size}\n")
        path.write_text(text + f"  T_cn_cnm1: {self.T.tolist()}\n")
        return [path]

    def opencv(self, path):
        text = "%YAML:1.0\n---\ndistortion_model: radtan\n"
        for name, values in (("M1", self.matrix(0)), ("M2", self.matrix(1)), ("D1", self.D[:1]),
                             ("D2", self.D[1:]), ("R", self.T[:3, :3]), ("T", self.T[:3, 3:])):
            rows, cols = np.shape(values)
            text += (f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n"
                     f"   data: {np.ravel(values).tolist()}\n")
        path.write_text(text)
        return [path]

    def camera_infos(self):
        """The rectification that ROS's camera_calibration would store."""
        T = np.linalg.inv(self.T)
        baseline = np.linalg.norm(T[:3, 3])
        x = T[:3, 3] / baseline
        y = np.cross([0, 0, 1], x)
        y /= np.linalg.norm(y)
        left = np.stack([x, y, np.cross(x, y)])
        infos = []
        for side, R in enumerate((left, left @ T[:3, :3])):
            P = np.array([[210, 0, 180, -210 * baseline * side], [0, 210, 120, 0], [0, 0, 1, 0]])
            infos.append({"width": self.size[0], "height": self.size[1],
                          "distortion_model": "plumb_bob", "D": [*self.D[side], 0.0],
                          "K": self.matrix(side).ravel().tolist(), "R": R.ravel().tolist(),
                          "P": P.ravel().tolist()})
        return infos


@pytest.fixture(scope="module")
def rig(hall):
    return Rig(hall)


def run(folder, *arguments):
    """kys-slam run; the folder of the results."""
    assert cli.main(["run", *map(str, arguments), "--output", str(folder), "--quiet"]) == 0
    return folder


@pytest.mark.parametrize("kind, encoding, calibration", [
    ("ros1", "mono8", "kalibr"), ("ros1", "png", "opencv"), ("ros2", "mono8", "camera_info"),
    ("ros2", "png", "kalibr"), ("mcap", "mono8", "opencv"), ("mcap", "png", "camera_info")])
def test_bags_give_the_folders_trajectory(shots, rig, hall_tum, tmp_path, kind, encoding,
                                          calibration):
    """To the byte: neither the container nor the words of the calibration matter."""
    bag = tmp_path / ("drone.bag" if kind == "ros1" else "drone")
    arguments, infos = [], None
    if calibration == "camera_info":
        infos = rig.camera_infos()
    else:
        arguments = ["--calibration", *getattr(rig, calibration)(tmp_path / "calibration.yaml")]
    write_bag(bag, kind, shots, encoding, infos=infos)
    assert (run(tmp_path / "run", bag, *arguments) / "trajectory.tum").read_bytes() == hall_tum


def test_jitter_and_loss(shots, rig, tmp_path):
    """Right images up to 8 ms late, a tenth of all images lost: every pair that can be is used."""
    rng = np.random.default_rng(1)
    jitter = rng.integers(0, 8_000_001, len(shots))
    lost = rng.random((len(shots), 2)) < 0.1
    write_bag(tmp_path / "lossy", "mcap", shots, "png", lambda i, side: lost[i, side],
              lambda i: int(jitter[i]))
    files = rig.kalibr(tmp_path / "camchain.yaml")
    recording = recordings.open_bag(tmp_path / "lossy", kys_slam.read_stereo_rig(files))
    pairable = [str(stamp) for (stamp, *_), gone in zip(shots, lost) if not gone.any()]
    assert [frame.name for frame in recording] == pairable
    times, _ = kys_slam.read_tum(run(tmp_path / "run", tmp_path / "lossy", "--calibration", *files)
                                 / "trajectory.tum")
    assert len(times) >= 0.98 * len(pairable)


FISHEYE = [(-0.0134, 0.0207, -0.0127, 0.0026), (-0.0110, 0.0180, -0.0108, 0.0020)]


def fisheye_map(size, K, radtan, coefficients):
    """Where each pixel of an equidistant camera (Kannala and Brandt, PAMI 2006) lies in the image
    of a radial-tangential one with the same K: x and y, (H, W)."""
    fx, fy, cx, cy = K
    u, v = np.meshgrid(np.arange(size[0], dtype=float), np.arange(size[1], dtype=float))
    x, y = (u - cx) / fx, (v - cy) / fy
    bent = np.hypot(x, y)
    theta = bent.copy()
    for _ in range(20):  # inverse of bent = theta (1 + k1 theta^2 + ...)
        t2 = theta**2
        theta = bent / (1 + sum(k * t2**(i + 1) for i, k in enumerate(coefficients)))
    stretch = np.where(bent > 1e-9, np.tan(theta) / np.maximum(bent, 1e-12), 1)
    x, y = x * stretch, y * stretch
    k1, k2, p1, p2 = radtan
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2 * r2
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return (fx * xd + cx).astype(np.float32), (fy * yd + cy).astype(np.float32)


def test_equidistant_lenses(hall, shots, rig, tmp_path):
    """The world seen through fisheye lenses: accuracy within the band of the regression suite, whose
    case runs sequentially."""
    cv2 = pytest.importorskip("cv2")
    for side in range(2):
        (tmp_path / ("left", "right")[side]).mkdir()
        where = fisheye_map(rig.size, rig.K[side], rig.D[side], FISHEYE[side])
        for shot in shots:
            image = cv2.imread(str(shot[1 + side]), cv2.IMREAD_GRAYSCALE)
            image = cv2.remap(image, *where, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE)
            cv2.imwrite(str(tmp_path / ("left", "right")[side] / f"{shot[0]}.png"), image,
                        [cv2.IMWRITE_PNG_COMPRESSION, 1])
    files = rig.kalibr(tmp_path / "camchain.yaml", "equidistant", FISHEYE)
    out = run(tmp_path / "run", tmp_path, "--calibration", *files, "--schedule", "sequential")
    times, poses = kys_slam.read_tum(out / "trajectory.tum")
    assert len(times) == len(shots)
    # The ground truth of the folder is that of its own rectified left camera; the other
    # rectification turns the camera a little about its centre, which positions do not see.
    truth = kys_slam.open_sequence(hall).ground_truth
    figures = kys_slam.evaluate(*truth, times, poses)
    case = json.loads((ROOT / "tests/regression/hall.json").read_text())
    assert figures["ate_m"]["rmse"] <= case["expected"]["ate"]["band"][1]


def test_masks_as_pictures_do_what_mode_mask_does(tmp_path):
    """Movers of the street as PNG files; nothing else is known of them."""
    cv2 = pytest.importorskip("cv2")
    street = world("street-620x188-80-1")
    priors = world("street-620x188-80-1-priors")
    for side in ("left", "right"):
        (tmp_path / "masks" / side).mkdir(parents=True)
    covered = 0
    for path in sorted(priors.glob("*.kysp")):
        for side, camera in zip(("left", "right"), kys_slam.read_prior(path).cameras):
            moves = np.concatenate([[False], (camera.segments["flags"] & DYNAMIC) != 0])
            mask = moves[camera.segment_map].astype(np.uint8)
            covered += np.count_nonzero(mask)
            cv2.imwrite(str(tmp_path / "masks" / side / f"{path.stem}.png"), mask)
    assert covered > 0
    run_program("run_stereo_kitti", street, "--priors", priors, "--mode", "mask", "--quiet",
                "--output", tmp_path / "mode")
    run(tmp_path / "pictures", street, "--masks", tmp_path / "masks", "--mode", "stock")
    assert ((tmp_path / "pictures" / "trajectory.tum").read_bytes() ==
            (tmp_path / "mode" / "trajectory.tum").read_bytes())
