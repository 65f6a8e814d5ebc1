# SPDX-License-Identifier: BSD-3-Clause
"""Calibrations in every format, rectification, the check of a pair."""

import numpy as np
import pytest

import kys_slam
from kys_slam import cli

# A rig as no tool would give it: two different cameras, turned by some degrees.
K = {"left": (458.654, 457.296, 367.215, 248.375), "right": (457.587, 456.134, 379.999, 255.238)}
RADTAN = {"left": (-0.2834, 0.0740, 0.00019, 1.8e-05), "right": (-0.2837, 0.0745, -0.0001, -3.6e-05)}
FISHEYE = {"left": (0.0034, 0.0007, -0.0020, 0.0002), "right": (0.0040, 0.0, -0.0018, 0.0001)}
SIZE = (752, 480)


def rotation(x, y, z):
    cx, cy, cz, sx, sy, sz = *np.cos((x, y, z)), *np.sin((x, y, z))
    return (np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]]) @
            np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]) @
            np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]]))


T_RIGHT_LEFT = np.eye(4)
T_RIGHT_LEFT[:3, :3] = rotation(0.004, -0.012, 0.008)
T_RIGHT_LEFT[:3, 3] = (-0.11, 0.0004, -0.0008)


def numbers(values):
    return "[" + ", ".join(repr(float(v)) for v in np.ravel(values)) + "]"


def kalibr(lens="radtan", coefficients=RADTAN, T=T_RIGHT_LEFT):
    text = ""
    for i, side in enumerate(("left", "right")):
        text += (f"cam{i}:\n  camera_model: pinhole\n  distortion_model: {lens}\n"
                 f"  distortion_coeffs: {numbers(coefficients[side])}\n"
                 f"  intrinsics: {numbers(K[side])}\n  resolution: [{SIZE[0]}, {SIZE[1]}]\n")
        if i == 1:
            text += "  T_cn_cnm1:\n" + "".join(f"  - {numbers(row)}\n" for row in T)
    return text


def opencv_matrix(name, values):
    rows = np.atleast_2d(values)
    return (f"{name}: !!opencv-matrix\n   rows: {rows.shape[0]}\n   cols: {rows.shape[1]}\n"
            f"   dt: d\n   data: {numbers(rows)}\n")


def camera_matrix(side):
    fx, fy, cx, cy = K[side]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def opencv(unit=1.0):
    text = "%YAML:1.0\n---\ndistortion_model: radtan\n"
    for i, side in enumerate(("left", "right"), 1):
        text += opencv_matrix(f"M{i}", camera_matrix(side)) + opencv_matrix(f"D{i}", RADTAN[side])
    return (text + opencv_matrix("R", T_RIGHT_LEFT[:3, :3]) +
            opencv_matrix("T", T_RIGHT_LEFT[:3, 3:] / unit))


def own(lens="radtan", coefficients=RADTAN):
    text = ""
    for side in ("left", "right"):
        fx, fy, cx, cy = K[side]
        text += (f"{side}: {{width: {SIZE[0]}, height: {SIZE[1]}, fx: {fx}, fy: {fy}, cx: {cx}, "
                 f"cy: {cy}, model: {lens}, distortion: {numbers(coefficients[side])}}}\n")
    return text + f"T_left_right: {numbers(np.linalg.inv(T_RIGHT_LEFT))}\n"


def camera_infos():
    """As ROS's camera_calibration has them: with the rotations of some rectification."""
    # Rectifying rotations: x along the baseline, in both cameras.
    T = np.linalg.inv(T_RIGHT_LEFT)
    x = T[:3, 3] / np.linalg.norm(T[:3, 3])
    y = np.cross([0, 0, 1], x) / np.linalg.norm(np.cross([0, 0, 1], x))
    left = np.stack([x, y, np.cross(x, y)])
    right = left @ T[:3, :3]
    baseline = np.linalg.norm(T[:3, 3])
    infos = []
    for side, R, shift in (("left", left, 0), ("right", right, -430 * baseline)):
        P = np.array([[430, 0, 370, shift], [0, 430, 240, 0], [0, 0, 1, 0]])
        infos.append({"width": SIZE[0], "height": SIZE[1], "distortion_model": "plumb_bob",
                      "D": list(map(float, RADTAN[side])) + [0.0],
                      "K": camera_matrix(side).ravel().tolist(), "R": R.ravel().tolist(),
                      "P": P.ravel().tolist()})
    return infos


def camera_info_yaml(info):
    return (f"image_width: {info['width']}\nimage_height: {info['height']}\ncamera_name: x\n"
            f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: {numbers(info['K'])}\n"
            f"distortion_model: plumb_bob\n"
            f"distortion_coefficients: {{rows: 1, cols: 5, data: {numbers(info['D'])}}}\n"
            f"rectification_matrix: {{rows: 3, cols: 3, data: {numbers(info['R'])}}}\n"
            f"projection_matrix: {{rows: 3, cols: 4, data: {numbers(info['P'])}}}\n")


def rectified(tmp_path, *texts, unit=1.0):
    files = []
    for i, text in enumerate(texts):
        files.append(tmp_path / f"{i}.yaml")
        files[-1].write_text(text)
    rig = kys_slam.read_stereo_rig(files, unit)
    rig.set_image_size(*SIZE)
    return kys_slam.StereoRectifier(rig).camera


def close(a, b):
    return all(getattr(a, k) == pytest.approx(getattr(b, k), rel=1e-5)
               for k in ("fx", "fy", "cx", "cy", "baseline"))


def test_every_format_gives_the_same_camera(tmp_path):
    reference = rectified(tmp_path, kalibr())
    assert reference.baseline == pytest.approx(np.linalg.norm(T_RIGHT_LEFT[:3, 3]), rel=1e-9)
    assert close(rectified(tmp_path, opencv()), reference)
    assert close(rectified(tmp_path, opencv(unit=0.001), unit=0.001), reference)
    assert close(rectified(tmp_path, own()), reference)
    infos = camera_infos()
    assert close(rectified(tmp_path, *map(camera_info_yaml, infos)), reference)
    rig = kys_slam.rig_from_camera_info(infos, "bag")
    assert close(kys_slam.StereoRectifier(rig).camera, reference)


@pytest.mark.parametrize("text", [kalibr(), kalibr("equidistant", FISHEYE), opencv(), own()])
def test_calibrations_are_imported(tmp_path, capsys, text):
    given, imported = tmp_path / "given.yaml", tmp_path / "rig.yaml"
    given.write_text(text)
    size = ["--size", "x".join(map(str, SIZE))]
    call = ["calibrate", str(given), *size, "--output", str(imported)]
    assert cli.main(call) == 0
    figures = capsys.readouterr().out.splitlines()
    assert cli.main(["calibrate", str(imported)]) == 0
    assert capsys.readouterr().out.splitlines() == figures[:-1]
    assert rectified(tmp_path, imported.read_text()).baseline == pytest.approx(
        rectified(tmp_path, text).baseline, rel=1e-14)
    assert cli.main(call) == 2 and "--overwrite" in capsys.readouterr().err
    assert cli.main([*call, "--overwrite"]) == 0


def test_imported_calibrations_keep_every_digit(tmp_path):
    rigs = []
    for text in (own(), ""):
        file = tmp_path / "rig.yaml"
        file.write_text(text or rigs[0].to_yaml())
        rigs.append(kys_slam.read_stereo_rig([file]))
    (*cameras, pose), (*cameras_again, pose_again) = (rig.to_yaml().splitlines() for rig in rigs)
    assert cameras == cameras_again and len(cameras) == 5
    pose, pose_again = (np.array(eval(line.split(":")[1])) for line in (pose, pose_again))
    assert np.abs(pose - np.linalg.inv(T_RIGHT_LEFT).ravel()).max() < 1e-14
    assert np.abs(pose - pose_again).max() < 1e-14
    assert rigs[0].size == rigs[1].size == SIZE
    file.write_text(opencv())
    with pytest.raises(kys_slam.InputError, match="size"):
        kys_slam.read_stereo_rig([file]).to_yaml()


def fisheye_pixel(side, ray):
    """The equidistant model, written down again (Kannala and Brandt, PAMI 2006)."""
    r = np.hypot(ray[..., 0], ray[..., 1])
    theta = np.arctan2(r, ray[..., 2])
    k1, k2, k3, k4 = FISHEYE[side]
    bent = theta * (1 + k1 * theta**2 + k2 * theta**4 + k3 * theta**6 + k4 * theta**8)
    fx, fy, cx, cy = K[side]
    return fx * bent * ray[..., 0] / r + cx, fy * bent * ray[..., 1] / r + cy


def test_equidistant_lenses_are_rectified(tmp_path):
    (tmp_path / "rig.yaml").write_text(kalibr("equidistant", FISHEYE))
    rectifier = kys_slam.StereoRectifier(kys_slam.read_stereo_rig([tmp_path / "rig.yaml"]))
    camera = rectifier.camera
    # Points in space, drawn as blobs into both raw images, lie on one row after rectification and
    # have the disparity of their depth.
    rng = np.random.default_rng(5)
    for _ in range(6):
        p_left = np.array([*rng.uniform(-0.5, 0.5, 2), 1.0]) * rng.uniform(2, 6)
        p_right = T_RIGHT_LEFT[:3, :3] @ p_left + T_RIGHT_LEFT[:3, 3]
        found = []
        for side, p, rectify in (("left", p_left, rectifier.rectify_left),
                                 ("right", p_right, rectifier.rectify_right)):
            u, v = fisheye_pixel(side, p)
            x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
            blob = 255 * np.exp(-((x - u)**2 + (y - v)**2) / (2 * 4.0**2))
            image = rectify(np.rint(blob).astype(np.uint8)).astype(float)
            yy, xx = np.mgrid[:SIZE[1], :SIZE[0]]
            found.append(((image * xx).sum() / image.sum(), (image * yy).sum() / image.sum()))
        (ul, vl), (ur, vr) = found
        assert vl == pytest.approx(vr, abs=0.15)
        depth = camera.fx * camera.baseline / (ul - ur)
        assert depth == pytest.approx(p_left[2], rel=0.02)


def test_wrong_calibrations_say_so(tmp_path):
    def fails(match, *texts, unit=1.0):
        with pytest.raises(kys_slam.InputError, match=match):
            rectified(tmp_path, *texts, unit=unit)

    fails("another unit", opencv(unit=0.001))
    fails("neither Kalibr", "a: 1\n")
    fails("not a calibration", "just text")
    fails("T_cn_cnm1", kalibr().replace("T_cn_cnm1", "T_other"))
    fails("resolution", kalibr().replace("resolution: [752", "resolution: [-752"))
    fails("finite", kalibr().replace("458.654", ".nan"))
    fails("omni", kalibr().replace("pinhole", "omni"))
    fails("distortion model", kalibr(lens="fov"))
    fails("4 coefficients", kalibr("equidistant", {s: c[:3] for s, c in FISHEYE.items()}))
    fails("right camera", camera_info_yaml(camera_infos()[1]))
    infos = camera_infos()
    fails("swapped", *map(camera_info_yaml, infos[::-1]))
    fails("the right of", kalibr(T=np.linalg.inv(T_RIGHT_LEFT)))
    fails("rigid", kalibr(T=2 * T_RIGHT_LEFT))
    with pytest.raises(kys_slam.InputError, match="100x100"):
        rig = kys_slam.rig_from_camera_info(infos, "bag")
        rig.set_image_size(100, 100)


def test_pair_check(corridor):
    left, right, *_ = corridor[0]
    good = kys_slam.check_stereo_pair(left, right)
    assert good.problem == "" and good.matches > 100
    assert abs(good.row_offset) < 0.5 and good.median_disparity > 1
    assert "swapped" in kys_slam.check_stereo_pair(right, left).problem
    assert "not rectified" in kys_slam.check_stereo_pair(left, np.roll(right, 4, axis=0)).problem
    assert kys_slam.check_stereo_pair(left * 0, right).problem == ""  # nothing can be said


def test_gray_weights():
    rgb = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]]], np.uint8)
    expected = np.rint(rgb @ [0.299, 0.587, 0.114])
    assert np.array_equal(kys_slam.to_gray(rgb), expected)
    assert np.array_equal(kys_slam.to_gray(rgb[..., ::-1], bgr=True), expected)
