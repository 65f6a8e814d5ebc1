# SPDX-License-Identifier: BSD-3-Clause
"""Calibration by recordings: kys-slam calibrate, and runs that begin with its output."""

import json
import math
import shutil

import numpy as np
import pytest

import kys_slam
from conftest import BIN, run_program
from kys_slam import InputError, LogicError, cli

CAMERA = dict(width=1241, height=376, fx=718.856, fy=718.856, cx=607.1928, cy=185.2157, baseline=0.5371657)
NAMES = ("left_k1 left_k2 left_p1 left_p2 right_k1 right_k2 right_p1 right_p2 yaw pitch roll focal_ratio offset "
         "row baseline_y baseline_z focal").split()


def correction(**changed):
    """A calibration file with a correction of CAMERA."""
    given = dict(CAMERA, **changed)
    side = "{width: %(width)d, height: %(height)d, fx: %(fx)r, fy: %(fy)r, cx: %(cx)r, cy: %(cy)r}" % given
    covariance = [1e-6 if r == c else 0 for r in range(len(NAMES)) for c in range(r + 1)]
    return (f"left: {side}\nright: {side}\n"
            f"T_left_right: [1, 0, 0, {given['baseline']}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
            "correction:\n  given: {" + ", ".join(f"{k}: {v!r}" for k, v in given.items()) + "}\n"
            "  parameters: {" + ", ".join(f"{name}: {0.3 if name == 'offset' else 0.001}" for name in NAMES) + "}\n"
            f"  covariance: {covariance}\n")


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """Feature files of two drives along a curve with the error of KITTI's rig."""
    folder = tmp_path_factory.mktemp("drives")
    rows = []
    for k in range(50):
        a = 0.01 * k
        c, s = math.cos(a), math.sin(a)
        rows.append([c, 0, s, 60 * (1 - c), 0, 1, 0, 0, -s, 0, c, 60 * s])
    np.savetxt(folder / "curve.txt", rows)
    for seed in (1, 2):
        run_program("simulate_features", folder / "curve.txt", "--output", folder / f"{seed}.features", "--seed",
                    seed, "--features", 800, "--rig-error", "kitti", "--quiet")
    return folder


def test_a_system_begins_with_a_correction(tmp_path):
    file = tmp_path / "refined.yaml"
    file.write_text(correction())
    assert kys_slam.has_rig_correction(file)
    slam = kys_slam.System(kys_slam.StereoCamera(**CAMERA))
    slam.start_rig(file)
    image = np.zeros((CAMERA["height"], CAMERA["width"]), np.uint8)
    slam.feed(image, image, 0.0)
    with pytest.raises(LogicError):
        slam.start_rig(file)
    with pytest.raises(InputError, match="another calibration"):
        kys_slam.System(kys_slam.StereoCamera(**dict(CAMERA, fx=700.0))).start_rig(file)
    file.write_text(correction().split("correction:")[0])
    assert not kys_slam.has_rig_correction(file)
    with pytest.raises(InputError, match="no correction"):
        kys_slam.System(kys_slam.StereoCamera(**CAMERA)).start_rig(file)


def test_a_copy_does_not_lose_the_correction(tmp_path, capsys):
    file = tmp_path / "refined.yaml"
    file.write_text(correction())
    assert cli.main(["calibrate", str(file)]) == 0
    assert "with a correction" in capsys.readouterr().out
    assert cli.main(["calibrate", str(file), "--output", str(tmp_path / "x.yaml")]) == 2
    assert not (tmp_path / "x.yaml").exists()


def test_recordings_give_a_calibration_that_runs_take(drives, tmp_path, capfd, monkeypatch):
    if not (BIN / "calibrate_rig").exists():
        pytest.skip("calibrate_rig is not built")
    monkeypatch.setenv("KYS_BIN_DIR", str(BIN))
    refined, figures = tmp_path / "refined.yaml", tmp_path / "figures.json"
    recordings = [str(drives / f"{seed}.features") for seed in (1, 2)]
    call = ["calibrate", *recordings, "-o", str(refined), "--json", str(figures)]
    assert cli.main(call) == 0, capfd.readouterr().err
    assert "determined" in capfd.readouterr().out
    maps = json.loads(figures.read_text())["maps"]
    assert [m["after"]["disparity"] < m["before"]["disparity"] for m in maps] == [True, True]
    assert kys_slam.has_rig_correction(refined)
    assert cli.main(call) == 2 and "--overwrite" in capfd.readouterr().err
    run = ["run", recordings[0], "--quiet", "--schedule", "sequential", "--output"]
    assert cli.main([*run, str(tmp_path / "plain")]) == 0
    assert cli.main([*run, str(tmp_path / "corrected"), "--calibration", str(refined)]) == 0
    trajectories = [(tmp_path / name / "trajectory.tum").read_text() for name in ("plain", "corrected")]
    assert trajectories[0] != trajectories[1]
    capfd.readouterr()
    # A calibration without a correction says nothing that the recording does not.
    refined.write_text(refined.read_text().split("correction:")[0].split("# How")[0])
    assert cli.main([*run, str(tmp_path / "other"), "--calibration", str(refined)]) == 2
    assert "contains its calibration" in capfd.readouterr().err


def test_the_program_may_be_missing(drives, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("KYS_BIN_DIR", "")
    monkeypatch.setattr(shutil, "which", lambda *_, **__: None)
    assert cli.main(["calibrate", str(drives / "1.features"), "-o", str(tmp_path / "x.yaml")]) == 2
    error = capsys.readouterr().err
    assert "calibrate_rig is not installed" in error and error.count("\n") == 1


def test_bad_recordings_are_named(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    out = str(tmp_path / "x.yaml")
    assert cli.main(["calibrate", str(tmp_path / "empty"), "-o", out]) == 2
    assert "empty" in capsys.readouterr().err
    assert cli.main(["calibrate", str(tmp_path / "empty")]) == 2
    assert "--output" in capsys.readouterr().err
    assert not (tmp_path / "x.yaml").exists()
