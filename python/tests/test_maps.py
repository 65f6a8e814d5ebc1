# SPDX-License-Identifier: BSD-3-Clause
"""Saved maps: kys-slam map."""

import json
import math
import shutil

import numpy as np
import pytest

from conftest import BIN, run_program
from kys_slam import cli


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A run of simulated features along a curve, with its map."""
    folder = tmp_path_factory.mktemp("drive")
    rows = []
    for k in range(30):
        a = 0.01 * k
        c, s = math.cos(a), math.sin(a)
        rows.append([c, 0, s, 60 * (1 - c), 0, 1, 0, 0, -s, 0, c, 60 * s])
    np.savetxt(folder / "curve.txt", rows)
    run_program("simulate_features", folder / "curve.txt", "--output", folder / "a.features",
                "--features", 800, "--quiet")
    call = ["run", str(folder / "a.features"), "--output", str(folder / "run"), "--quiet", "--schedule", "sequential",
            "--save-map", str(folder / "a.map")]
    assert cli.main(call) == 0
    return folder


@pytest.fixture(autouse=True)
def programs(monkeypatch):
    monkeypatch.setenv("KYS_BIN_DIR", str(BIN))


def test_info(drive, capfd):
    assert cli.main(["map", "info", str(drive / "a.map"), "--json"]) == 0
    info = json.loads(capfd.readouterr().out)
    assert info["version"] == 2 and info["keyframes"] > 5
    assert cli.main(["map", "info", str(drive / "curve.txt")]) == 2
    error = capfd.readouterr().err
    assert "curve.txt" in error and error.count("\n") == 1


def test_refine(drive, capfd):
    if not (BIN / "refine_map").exists():
        pytest.skip("refine_map is not built")
    call = ["map", "refine", str(drive / "a.map"), "-o", str(drive / "refined.map"), "--free", "offset", "--quiet"]
    assert cli.main(call) == 0, capfd.readouterr().err
    assert "determined" in capfd.readouterr().out
    figures = json.loads((drive / "refinement.json").read_text())
    assert [p["name"] for p in figures["parameters"] if p["free"]] == ["offset", "row"]
    run = ["run", str(drive / "a.features"), "--quiet", "--schedule", "sequential", "--output", str(drive / "again"),
           "--load-map", str(drive / "refined.map")]
    assert cli.main(run) == 0, capfd.readouterr().err


def test_evaluate_draws(drive, capfd):
    if not (BIN / "evaluate_map").exists():
        pytest.skip("evaluate_map is not built")
    picture = drive / "errors.png"
    call = ["map", "evaluate", str(drive / "a.map"), "--truth", str(drive / "run" / "map.ply"), "--plot", str(picture)]
    assert cli.main(call) == 0, capfd.readouterr().err
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "map to truth" in capfd.readouterr().out
    assert cli.main([*call[:-1], str(drive / "no" / "x.png")]) == 2
    assert cli.main(call[:-1]) == 2


def test_the_program_may_be_missing(drive, capsys, monkeypatch):
    monkeypatch.setenv("KYS_BIN_DIR", "")
    monkeypatch.setattr(shutil, "which", lambda *_, **__: None)
    assert cli.main(["map", "merge", "a.map", "b.map", "-o", "c.map"]) == 2
    error = capsys.readouterr().err
    assert "merge_maps is not installed" in error and error.count("\n") == 1
