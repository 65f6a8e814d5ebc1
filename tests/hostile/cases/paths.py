# SPDX-License-Identifier: BSD-3-Clause
"""Files and folders."""
import os
import shutil

from harness import (FRAMES, as_nobody, case, complete, expect, make_euroc, passed, png, refusals,
                     refused, saved)


def loop_at(name):
    def prepare(f):
        path = os.path.join(f.sequence, name)
        if os.path.isdir(path):
            shutil.rmtree(path)
        elif os.path.exists(path):
            os.remove(path)
        os.symlink(os.path.basename(name), path)
    return prepare


def whole_sequence_is_a_loop(f):
    shutil.rmtree(f.sequence)
    os.symlink("seq", f.sequence)


def sequence_is_a_fifo(f):
    shutil.rmtree(f.sequence)
    os.mkfifo(f.sequence)


def fifo_as(name, *arguments):
    def prepare(f):
        path = os.path.join(f.path, name)
        if os.path.exists(path):
            os.remove(path)
        os.mkfifo(path)
        return [a.format(path) for a in arguments]
    return prepare


refusals("paths", {
    "loop_as_sequence": (whole_sequence_is_a_loop, ["seq", "symbolic links"]),
    "loop_as_calib": (loop_at("calib.txt"), ["calib.txt", "symbolic links"]),
    "loop_as_poses": (loop_at("poses.txt"), ["poses.txt", "symbolic links"]),
    "loop_as_images": (loop_at("image_0"), ["image_0", "symbolic links"]),
    "too_long": (lambda f: ["--config", "x" * 4000], ["too long"]),
    "config_is_a_folder": (lambda f: ["--config", f.path], ["not a regular file"]),
    "config_is_a_fifo": (fifo_as("c.yaml", "--config", "{}"), ["c.yaml", "not a regular file"]),
    "calib_is_a_fifo": (fifo_as("seq/calib.txt"), ["calib.txt", "not a regular file"]),
    "image_is_a_fifo": (fifo_as("seq/image_0/000000.png"), ["000000.png", "not a regular file"]),
    "sequence_is_a_fifo": (sequence_is_a_fifo, ["seq", "not a folder"]),
    "map_is_a_fifo": (fifo_as("m.map", "--load-map", "{}"), ["m.map", "not a regular file"]),
})


@case
def paths_label_space_is_long(f, programs):
    refused(programs.run("build_priors", f.sequence, "--panoptic-left", f.sequence, "--output",
                         f.output, "--label-space", "a" * 100000), "label space")


@case
def paths_without_permission(f, programs):
    os.chmod(f.path, 0o777)
    for name in ("image_0", "calib.txt", ""):
        path = os.path.join(f.sequence, name)
        mode = os.stat(path).st_mode
        os.chmod(path, 0)
        result = programs.kitti(f, before=as_nobody())
        os.chmod(path, mode)
        refused(result, f.sequence, "Permission denied")
    os.makedirs(f("d", "sequences"))
    os.makedirs(f("d", "poses"), 0)
    os.rename(f.sequence, f("d", "sequences", "06"))
    refused(programs.run("run_stereo_kitti", f("d", "sequences", "06"), "--output", f.output,
                         before=as_nobody()), "06.txt", "Permission denied")


@case
def paths_label_space_without_permission(f, programs):
    os.chmod(f.path, 0o777)
    os.mkdir(f("locked"), 0)
    refused(programs.run("build_priors", f.sequence, "--panoptic-left", f.sequence, "--output",
                         f.output, "--label-space", f("locked", "mine"), before=as_nobody()),
            "locked/mine")


@case
def paths_too_long(f, programs):
    refused(programs.run("run_stereo_kitti", "/" + "a/" * 2043, "--output", f.output), "no such folder")
    refused(programs.run("run_stereo_kitti", f.sequence, "--output", f("b" * 300)), "too long")


@case
def paths_ground_truth_is_a_loop(f, programs):
    os.symlink("gt", f("gt"))
    refused(programs.run("evaluate_trajectory", "--reference", f("gt"), "--estimate", f("gt")), "gt",
            "symbolic links")


@case
def paths_output_of_the_simulator_is_a_loop(f, programs):
    os.symlink("lo", f("lo"))
    refused(programs.run("simulate_sequence", "street", "--output", f("lo"), "--frames", "20"),
            "lo", "symbolic links")
    expect(not os.path.exists(f("lo.partial")), "rendered before it was checked")


@case
def paths_loop_in_euroc(f, programs):
    make_euroc(f("euroc"), f.sequence)
    for name in ("mav0/cam1", "mav0"):
        shutil.rmtree(f("euroc", name))
        os.symlink(os.path.basename(name), f("euroc", name))
        refused(programs.run("run_stereo_euroc", f("euroc"), "--output", f.output, "--quiet"),
                "symbolic links")


@case
def paths_fifos_as_priors(f, programs):
    os.mkdir(f("priors"))
    os.mkfifo(f("priors", "000000.kysp"))
    refused(programs.kitti(f, "--priors", f("priors")), "000000.kysp", "not a regular file")
    refused(programs.run("inspect_priors", f("priors")), "000000.kysp", "not a regular file")
    refused(programs.run("inspect_priors", f("priors", "000000.kysp")), "not a regular file")
    os.mkfifo(f("c.yaml"))
    refused(programs.run("build_priors", f.sequence, "--panoptic-left", f.sequence, "--output",
                         f.output, "--config", f("c.yaml")), "c.yaml", "not a regular file")


@case
def paths_fifos_for_the_other_programs(f, programs):
    """No program waits for a pipe that is given as a file or a folder."""
    fifo = f("pipe")
    os.mkfifo(fifo)
    os.mkdir(f("run"))
    os.mkfifo(f("run", "objects.csv"))
    os.mkfifo(f("space.classes.csv"))
    os.mkfifo(f("space.table.csv"))
    for program, *arguments in (
            ("evaluate_trajectory", "--reference", fifo, "--estimate", fifo),
            ("evaluate_objects", f("run"), "--truth", fifo),
            ("evaluate_places", fifo), ("evaluate_stereo", fifo),
            ("simulate_features", fifo, "--output", f("x.features")),
            ("validate_priors", fifo, "--sequence", f.sequence),
            ("perturb_priors", "segments", fifo, "--output", f("x")),
            ("build_priors", f.sequence, "--panoptic-left", f.path, "--output", f.output,
             "--label-space", f("space")),
            ("rectify_sequence", fifo, "--output", f("x")),
            ("run_stereo_kitti", f.sequence, "--output", fifo)):
        refused(programs.run(program, *arguments), "")


@case
def paths_fifo_beside_segmentations(f, programs):
    os.mkdir(f("pan"))
    build = ["build_priors", f.sequence, "--panoptic-left", f("pan"), "--output", f.output]
    os.mkfifo(f("pan", "images.txt"))
    refused(programs.run(*build), "images.txt", "not a regular file")
    os.remove(f("pan", "images.txt"))
    f.write("pan/images.txt", "image_2" * 1000)
    refused(programs.run(*build), "images.txt", "bytes")


@case
def paths_names_that_are_not_utf8(f, programs):
    name = os.fsencode(f.path) + b"/se\xffq,\"\n"
    os.rename(f.sequence, name)
    result = programs.finish(programs.start("run_stereo_kitti",
                                            [name, "--output", f.output, "--quiet"]))
    passed(result)
    expect(complete(f)["sequence"] == 'se\\xffq,"\\n', "name in summary.json")
    os.remove(os.path.join(name, b"calib.txt"))
    result = programs.finish(programs.start("run_stereo_kitti", [name, "--output", f.output]))
    refused(result, "se\\xffq", "\\n", "calib.txt")


@case
def paths_name_that_is_not_utf8_and_an_error_half_way(f, programs):
    png(f.image(7), [bytes(8)] * 8)
    name = os.fsencode(f.path) + b"/se\xff"
    os.rename(f.sequence, name)
    result = programs.finish(programs.start("run_stereo_kitti",
                                            [name, "--output", f.output, "--quiet"]))
    refused(result, "se\\xff", "000007.png")
    summary = saved(f, 7)
    expect(summary["sequence"] == "se\\xff" and "se\\xff" in summary["end_reason"], summary)


@case
def paths_frame_names_with_commas(f, programs):
    for camera in (0, 1):
        for i in range(FRAMES):
            os.rename(f.image(i, camera), f.image(i, camera).replace(f"{i:06d}", f'a,"{i:06d}'))
    passed(programs.kitti(f))
    with open(os.path.join(f.output, "frames.csv"), encoding="utf-8") as file:
        row = file.readlines()[1]
    expect(row.startswith('0,"a,""000000",0.0'), row)


@case
def paths_output_into_the_input(f, programs):
    refused(programs.run("rectify_sequence", f.sequence, "--output", f.sequence), "itself")


@case
def paths_validate_priors_of_no_folder(f, programs):
    refused(programs.run("validate_priors", f("nothing"), "--sequence", f.sequence), "nothing",
            "not a folder")


@case
def paths_output_of_rectify_sequence_is_of_one_source(f, programs):
    rectify = ["rectify_sequence", f.sequence, "--output", f("rectified")]
    passed(programs.run(*rectify))
    os.remove(f("rectified", "image_1", "000003.png"))
    passed(programs.run(*rectify))  # goes on
    expect(os.path.isfile(f("rectified", "image_1", "000003.png")), "not made again")
    shutil.copytree(f.sequence, f("other"))
    rectify[1] = f("other")
    refused(programs.run(*rectify), "rectified", "not made of this sequence")
    f.write("full/notes.txt", "mine")
    refused(programs.run(*rectify[:3], f("full")), "full", "is not empty")


@case
def paths_output_of_rectify_sequence_is_of_one_calibration(f, programs):
    make_euroc(f("euroc"), f.sequence)
    rectify = ["rectify_sequence", f("euroc"), "--output", f("rectified")]
    passed(programs.run(*rectify))
    passed(programs.run(*rectify))
    for camera in (0, 1):
        path = f("euroc", "mav0", f"cam{camera}", "sensor.yaml")
        with open(path, encoding="ascii") as file:
            text = file.read()
        f.write(path, text.replace("[0.0, 0.0, 0.0, 0.0]", "[-0.2, 0.0, 0.0, 0.0]"))
    refused(programs.run(*rectify), f("rectified"), "another calibration")
    rectify[3] = f("anew")
    passed(programs.run(*rectify))
