# SPDX-License-Identifier: BSD-3-Clause
"""kys-slam check: the field of row differences, verdicts, and what a run says about the calibration."""

import json
import shutil

import numpy as np
import pytest

import kys_slam
from bags import write_bag
from conftest import run_program
from kys_slam import cli

OWN = """left: {width: 320, height: 240, fx: 250, fy: 250, cx: 159.5, cy: 119.5}
right: {width: 320, height: 240, fx: 250, fy: 250, cx: 159.5, cy: 119.5}
T_left_right: [1, 0, 0, 0.2,  0, 1, 0, 0,  0, 0, 1, 0,  0, 0, 0, 1]
"""


@pytest.fixture(scope="module")
def streets(tmp_path_factory):
    """{"good", "bent"}: folders of a simulated street, the second with the rig error of KITTI."""
    folder = tmp_path_factory.mktemp("streets")
    for name, error in (("good", ()), ("bent", ("--rig-error", "kitti"))):
        run_program("simulate_sequence", "street", "--output", folder / name, "--frames", 2,
                    "--images-only", "--quiet", *error)
    return {name: folder / name for name in ("good", "bent")}


def check(capsys, *arguments):
    """(exit status, stdout, stderr)"""
    status = cli.main(["check", *map(str, arguments)])
    return (status, *capsys.readouterr())


def write_images(folder, pairs):
    """Folders left and right with pairs as PNG, and their calibration; returns the arguments."""
    cv2 = pytest.importorskip("cv2")
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
    for i, pair in enumerate(pairs):
        for side, image in zip(("left", "right"), pair):
            cv2.imwrite(str(folder / side / f"{i:06d}.png"), image)
    (folder / "own.yaml").write_text(OWN)
    return [folder / "left", folder / "right", "--calibration", folder / "own.yaml", "--rate", 10]


def test_a_perfect_street_is_rectified(streets, capsys):
    status, out, err = check(capsys, streets["good"])
    assert (status, err) == (0, "")
    assert out.splitlines()[-1].startswith("rectified (rows agree to 0.0")


def test_a_bent_street_is_not(streets, capsys):
    status, out, err = check(capsys, streets["bent"])
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert lines[-1].startswith("not rectified: rows differ by up to ")
    table = [line.split() for line in lines if len(line) == 2 + 6 * 8]
    assert len(table) == 4
    status, out, _ = check(capsys, streets["bent"], "--json")
    d = json.loads(out)
    assert status == 0 and d["result"] == "not rectified" and d["verdict"] == lines[-1]
    assert d["pairs"] == 2 and d["rows_measured"] == np.sum(d["matches_per_cell"])
    assert [["-" if v is None else f"{v:.2f}" for v in row] for row in d["medians_px"]] == table
    assert d["rows_field_px"] > 0.2 and d["rows_sigma_after_px"] < d["rows_sigma_before_px"]
    # The measured error turns the field: rows of the right image are too low top left and bottom right.
    corners = [np.nanmean(np.array(d["medians_px"], float)[rows, columns])
               for rows in (slice(0, 2), slice(2, 4)) for columns in (slice(0, 2), slice(4, 6))]
    assert corners[1] < -0.2 < 0.2 < corners[0] and corners[2] < 0.1 < 0.2 < corners[3]


def test_the_picture(streets, tmp_path, capsys):
    cv2 = pytest.importorskip("cv2")
    pytest.importorskip("matplotlib")
    file = tmp_path / "field.png"
    status, out, _ = check(capsys, streets["bent"], "--plot", file)
    assert status == 0 and out.endswith(f"wrote {file}\n")
    picture = cv2.imread(str(file))
    assert picture.shape[1] > 600
    # Colours of both signs.
    blue, red = picture[:, :, 0].astype(int), picture[:, :, 2].astype(int)
    assert (blue - red > 40).sum() > 1000 and (red - blue > 40).sum() > 1000
    before = file.read_bytes()
    status, _, err = check(capsys, streets["bent"], "--plot", file)
    assert status == 2 and str(file) in err and file.read_bytes() == before
    assert check(capsys, streets["good"], "--plot", file, "--overwrite")[0] == 0
    assert file.read_bytes() != before
    status, out, err = check(capsys, streets["bent"], "--plot", tmp_path / "none" / "field.png")
    assert status == 2 and "none" in err and out == ""


def test_swapped_images_are_named(streets, tmp_path, capsys):
    shutil.copytree(streets["good"], tmp_path / "street")
    a, b = tmp_path / "street" / "image_0", tmp_path / "street" / "image_1"
    a.rename(tmp_path / "other")
    b.rename(a)
    (tmp_path / "other").rename(b)
    status, out, _ = check(capsys, tmp_path / "street")
    assert status == 0 and "swapped" in out.splitlines()[-1]
    assert json.loads(check(capsys, tmp_path / "street", "--json")[1])["result"] == "not a pair"
    # One pair is enough.
    assert "swapped" in check(capsys, tmp_path / "street", "--frames", 1)[1].splitlines()[-1]


def test_right_images_of_other_moments_are_named(corridor, tmp_path, capsys):
    """They are lower by something else in every pair."""
    late = [(left, np.roll(right, shift, axis=0))
            for shift, (left, right, *_) in zip((0, 1, -1, 1, 0, -1), corridor)]
    status, out, _ = check(capsys, *write_images(tmp_path, late), "--frames", 6)
    assert status == 0 and "not of the same moment" in out.splitlines()[-1]


def test_far_too_low_images_are_not_rectified(corridor, tmp_path, capsys):
    low = [(left, np.roll(right, 6, axis=0)) for left, right, *_ in corridor[:4]]
    status, out, _ = check(capsys, *write_images(tmp_path, low), "--json")
    d = json.loads(out)
    assert status == 0 and d["result"] == "not rectified" and "6.0 px" in d["verdict"]


def test_images_without_texture_tell_nothing(tmp_path, capsys):
    grey = np.full((240, 320), 90, np.uint8)
    status, out, err = check(capsys, *write_images(tmp_path, [(grey, grey)] * 3))
    assert status == 3 and err == ""
    assert out.splitlines()[-1].startswith("too few matches to tell")
    assert "-" in out and "nan" not in out
    d = json.loads(check(capsys, tmp_path, "--calibration", tmp_path / "own.yaml", "--rate", 10,
                         "--json")[1])
    assert d["result"] == "unknown" and d["medians_px"] == [[None] * 6] * 4


def test_pairs_are_spread_over_a_sequence(corridor, tmp_path, capsys):
    """The second half is a blank wall."""
    blank = np.full((240, 320), 90, np.uint8)
    pairs = [pair[:2] for pair in corridor[:6]] + [(blank, blank)] * 6
    arguments = write_images(tmp_path, pairs)

    def matches(*more):
        return json.loads(check(capsys, *arguments, "--json", *more)[1])["rows_measured"]

    few, all_pairs = matches("--frames", 2), matches("--frames", 100)
    assert few > 0 and 4 * few < all_pairs < 8 * few, "one of 2, and 6 of 12"
    assert matches("--start", 6) == 0


def test_a_bag_is_a_stream(corridor, tmp_path, capsys):
    arguments = write_images(tmp_path, [pair[:2] for pair in corridor])
    shots = [(10**18 + i * 10**8, tmp_path / "left" / f"{i:06d}.png",
              tmp_path / "right" / f"{i:06d}.png") for i in range(len(corridor))]
    bag = tmp_path / "corridor.bag"
    write_bag(bag, "ros1", shots, "mono8")
    status, out, _ = check(capsys, bag, *arguments[2:4], "--frames", 3, "--json")
    assert status == 0 and json.loads(out)["pairs"] == 3
    assert json.loads(out)["result"] == "rectified"


@pytest.mark.parametrize("options, named", [
    ([], "no such file"), (["--frames", "0"], "--frames"), (["--start", "99"], "99")])
def test_bad_input_is_one_line(streets, tmp_path, capsys, options, named):
    source = streets["good"] if options else tmp_path / "none"
    try:
        status, out, err = check(capsys, source, *options)
    except SystemExit as usage:  # argparse
        status, (out, err) = usage.code, capsys.readouterr()
    assert (status, out) == (2, "") and named in err and err.count("\n") == 1


def test_a_feature_file_has_no_rows(tmp_path, capsys):
    poses = tmp_path / "drive.txt"
    poses.write_text("".join(f"1 0 0 0 0 1 0 0 0 0 1 {z}\n" for z in range(5)))
    features = tmp_path / "drive.features"
    run_program("simulate_features", poses, "--output", features, "--quiet")
    status, out, err = check(capsys, features)
    assert (status, out) == (2, "") and "images" in err and err.count("\n") == 1


def test_row_meter_and_rig_from_python(corridor, corridor_camera):
    meter = kys_slam.RowMeter(corridor_camera)
    with pytest.raises(kys_slam.InputError, match="319x240"):
        meter.add(corridor[0][0], corridor[0][1][:, 1:])
    slam = kys_slam.System(corridor_camera, {"orb.features": 1000})
    for left, right, stamp, _ in corridor:
        lower = np.roll(right, 1, axis=0)
        meter.add(left, lower)
        slam.feed(left, lower, stamp)
    field = meter.field()
    assert field.pairs == len(corridor) and field.verdict == "not rectified"
    assert field.medians.shape == field.counts.shape == field.medians_after.shape == (4, 6)
    assert field.counts.sum() == len(field.matches) and field.matches.shape[1] == 4
    seen = np.isfinite(field.medians)
    assert seen.sum() > 12 and np.abs(field.medians[seen] - 1).max() < 0.1
    assert abs(field.field - 1) < 0.1 and str(field).startswith("not rectified")
    slam.finish()
    rig = slam.rig()
    assert rig.corrected == "all" and abs(rig.rows_field - 1) < 0.1
    assert abs(rig.parameters["row"].value - 1) < 0.2 and rig.parameters["row"].unit == "px"
    assert rig.offset == rig.parameters["offset"].value


def test_a_good_rig_stays(corridor, corridor_camera):
    slam = kys_slam.System(corridor_camera, {"orb.features": 1000})
    assert slam.rig().rows_field is None, "nothing seen yet"
    for left, right, stamp, _ in corridor[:3]:
        slam.feed(left, right, stamp)
    slam.finish()
    rig = slam.rig()
    assert rig.corrected == "none" and rig.rows_field < 0.1
    assert rig.offset == 0 and rig.offset_sigma is None
    assert all(p.value == 0 and p.sigma is None for p in rig.parameters.values())
