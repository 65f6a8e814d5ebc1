# SPDX-License-Identifier: BSD-3-Clause
"""Paths of the build and the data. Tests that need the real excerpts are skipped without them."""

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("KYS_SHARED_DATA_DIR", ROOT.parent / "shared" / "data"))
BIN = Path(os.environ.get("KYS_BIN_DIR", ROOT / "build/release/bin"))


def _excerpt(name):
    folder = DATA / name
    if not folder.is_dir():
        pytest.skip(f"shared/data/{name} is not there")
    return folder


@pytest.fixture(scope="session")
def kitti():
    return _excerpt("kitti_06_clip")


@pytest.fixture(scope="session")
def euroc():
    return _excerpt("euroc_v101_start")


def run_program(name, *arguments):
    """Runs one of the C++ programs; skips where it is not built."""
    program = BIN / name
    if not program.exists():
        pytest.skip(f"{name} is not built")
    subprocess.run([program, *map(str, arguments)], check=True, capture_output=True)


@pytest.fixture(scope="session")
def kitti_tum(kitti, tmp_path_factory):
    """trajectory.tum of the command line program on the KITTI excerpt."""
    folder = tmp_path_factory.mktemp("kitti")
    run_program("run_stereo_kitti", kitti, "--output", folder, "--quiet")
    return (folder / "trajectory.tum").read_bytes()


@pytest.fixture(scope="session")
def euroc_tum(euroc, tmp_path_factory):
    folder = tmp_path_factory.mktemp("euroc")
    run_program("run_stereo_euroc", euroc, "--output", folder, "--quiet", "--frames", 30)
    return (folder / "trajectory.tum").read_bytes()


@pytest.fixture(scope="session")
def corridor():
    """[(left, right, time, true position)] of a simulated corridor."""
    from kys_slam.demo import stereo_frame
    return [stereo_frame(i) for i in range(12)]


@pytest.fixture(scope="session")
def corridor_camera():
    import kys_slam
    from kys_slam.demo import CAMERA
    return kys_slam.StereoCamera(**CAMERA)
