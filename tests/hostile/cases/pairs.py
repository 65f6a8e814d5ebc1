# SPDX-License-Identifier: BSD-3-Clause
"""Calibrations and pairs of images."""
import os
import shutil
import time

from harness import (DISPARITY, FRAMES, FX, HEIGHT, WIDTH, case, complete, expect, make_euroc,
                     passed, png, refusals, refused, saved, wall, write_calibration)


def calibration(**values):
    return lambda f: write_calibration(f.sequence, **values)


def same_images(f):
    shutil.rmtree(os.path.join(f.sequence, "image_1"))
    shutil.copytree(os.path.join(f.sequence, "image_0"), os.path.join(f.sequence, "image_1"))


refusals("pair", {
    "absurd_focal_length": (calibration(fx=1e30), ["calib.txt", "focal length"]),
    "right_camera_above": (calibration(ty=100.0), ["calib.txt", "above or below"]),
})


@case
def pair_left_is_right(f, programs):
    same_images(f)
    result = programs.kitti(f)
    expect(result.status == 2, f"status {result.status}")
    warning, error = result.err.splitlines()
    expect("same image" in warning, result.err)
    expect("000004" in error and "give the images of two cameras" in error, result.err)
    saved(f, 4)


def warned(f, result, *parts):
    """One warning, on the console and in the summary."""
    expect(result.status in (0, 3), f"status {result.status}")
    warnings = complete(f)["warnings"]
    expect(len(warnings) == 1, f"warnings: {warnings}")
    expect(result.err.count("[warning]") == 1 and warnings[0] in result.err, result.err)
    for part in parts:
        expect(part in warnings[0], f"{part!r} is not in {warnings[0]!r}")


@case
def pair_swapped_is_told(f, programs):
    for old, new in (("image_0", "old"), ("image_1", "image_0"), ("old", "image_1")):
        os.rename(os.path.join(f.sequence, old), os.path.join(f.sequence, new))
    warned(f, programs.kitti(f), "left and right are swapped")


def bumpy(f, late):
    """Rows that move from frame to frame, the right camera's one frame later."""
    rows, frames = wall(), 21
    rows = rows + rows[:20]
    for i in range(frames):
        for camera in (0, 1):
            k = max(0, i - late * camera)
            left, top = 60 + 6 * k + camera * DISPARITY, (0, 2, 3, 1, 4, 0, 3)[k % 7]
            png(f.image(i, camera), [row[left:left + WIDTH] for row in rows[top:top + HEIGHT]])
    # Fast enough for the bumps to differ, slow enough for a camera to make them.
    f.write("seq/times.txt", "".join(f"{0.2 * i:.2f}\n" for i in range(frames)))
    return frames


@case
def pair_out_of_step_is_told(f, programs):
    frames = bumpy(f, late=1)
    result = programs.kitti(f)
    expect(result.status in (0, 3), f"status {result.status}: {result.err}")
    warnings = complete(f, frames)["warnings"]
    expect(sum("not of the same moment" in text for text in warnings) == 1, warnings)
    # The second right picture is the first one once more.
    expect(any("right image is that of the frame before" in text for text in warnings), warnings)
    bumpy(f, late=0)
    passed(programs.kitti(f))
    warnings = complete(f, frames)["warnings"]
    expect(warnings == [], f"a sound pair: {warnings}")


@case
def pair_with_rows_that_differ_is_told(f, programs):
    rows = wall()
    for i in range(FRAMES):
        left = 60 + 6 * i + DISPARITY
        moved = [row[left:left + WIDTH] for row in rows]
        png(f.image(i), moved[40:] + moved[:40])
    warned(f, programs.kitti(f), "not rectified", "40.0 px")


@case
def pair_euroc_of_another_size(f, programs):
    make_euroc(f("euroc"), f.sequence, resolution=(16384, 16384))
    begin = time.monotonic()
    refused(programs.run("run_stereo_euroc", f("euroc"), "--output", f.output, "--quiet"),
            "sensor.yaml", "16384")
    expect(time.monotonic() - begin < 20, "tables were made before the sizes were compared")


@case
def pair_euroc_calibration_names_the_file(f, programs):
    make_euroc(f("a"), f.sequence, distortion="[0.0, 0.0, 0.0]")
    refused(programs.run("run_stereo_euroc", f("a"), "--output", f.output),
            "sensor.yaml", "distortion_coefficients")
    make_euroc(f("b"), f.sequence, model="")
    refused(programs.run("run_stereo_euroc", f("b"), "--output", f.output),
            "sensor.yaml", "camera_model")


@case
def pair_map_of_another_camera(f, programs):
    passed(programs.kitti(f, "--save-map", f("m.map")))
    make_euroc(f("euroc"), f.sequence, distortion="[0.01, 0.0, 0.0, 0.0]")
    refused(programs.run("run_stereo_euroc", f("euroc"), "--output", f("other"), "--load-map",
                         f("m.map")), "m.map", "another camera", "than this one")
    write_calibration(f.sequence, fx=FX * 1.01)
    refused(programs.kitti(f, "--load-map", f("m.map")), "m.map", "camera")
