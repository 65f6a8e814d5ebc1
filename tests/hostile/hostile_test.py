#!/usr/bin/env python3
"""Input that nobody should give a program, and machines that give it too little. Every case: the
program ends by itself within its time, with the status and the line the table says, without an abort,
and what was tracked before is saved.

    hostile_test.py BIN_DIR [CASE ...]
"""
import json
import os
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import zlib

WIDTH, HEIGHT, FRAMES, DISPARITY = 320, 120, 12, 16
FX, BF = 200.0, 100.0
OUTPUTS = ("trajectory.tum", "trajectory.kitti", "keyframes.tum", "frames.csv", "graph.csv",
           "config.yaml", "map.ply", "summary.json")


def png(path, rows, width=None, height=None):
    """8-bit grey; `width` and `height` can be told wrongly."""
    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data +
                struct.pack(">I", zlib.crc32(kind + data)))
    header = struct.pack(">IIBBBBB", width or len(rows[0]), height or len(rows), 8, 0, 0, 0, 0)
    data = zlib.compress(b"".join(b"\0" + bytes(row) for row in rows), 1)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) +
                   chunk(b"IEND", b""))


def wall():
    """A picture of squares of all sizes, wider than the images: a wall seen while driving along."""
    state, width = 12345, WIDTH + 200
    rows = [bytearray([128]) * width for _ in range(HEIGHT)]
    for _ in range(1200):
        values = []
        for _ in range(5):
            state = (state * 6364136223846793005 + 1442695040888963407) % 2**64
            values.append(state >> 33)
        side = 4 + values[2] % 14
        x, y = values[0] % (width - side), values[1] % (HEIGHT - side)
        for row in rows[y:y + side]:
            row[x:x + side] = bytes([values[3] % 256]) * side
    return rows


class Folder:
    """What one case works with."""

    def __init__(self, path, sequence):
        self.path = path
        self.output = os.path.join(path, "out")
        self.sequence = os.path.join(path, "seq")
        shutil.copytree(sequence, self.sequence)

    def __call__(self, *names):
        return os.path.join(self.path, *names)

    def write(self, name, text):
        os.makedirs(os.path.dirname(self(name)), exist_ok=True)
        with open(self(name), "wb") as file:
            file.write(text if isinstance(text, bytes) else text.encode())
        return self(name)

    def image(self, frame, camera=1):
        return os.path.join(self.sequence, f"image_{camera}", f"{frame:06d}.png")


def make_sequence(folder):
    rows = wall()
    for camera in (0, 1):
        os.makedirs(os.path.join(folder, f"image_{camera}"))
    for i in range(FRAMES):
        for camera in (0, 1):
            left = 60 + 6 * i + camera * DISPARITY
            png(os.path.join(folder, f"image_{camera}", f"{i:06d}.png"),
                [row[left:left + WIDTH] for row in rows])
    with open(os.path.join(folder, "times.txt"), "w", encoding="ascii") as file:
        file.writelines(f"{0.1 * i:.2f}\n" for i in range(FRAMES))
    write_calibration(folder)


def write_calibration(folder, fx=FX, bf=BF, tx=0.0, ty=0.0):
    with open(os.path.join(folder, "calib.txt"), "w", encoding="ascii") as file:
        for name, x, y in (("P0", 0, 0), ("P1", -bf + tx, ty)):
            file.write(f"{name}: {fx} 0 {WIDTH / 2} {x} 0 {fx} {HEIGHT / 2} {y} 0 0 1 0\n")


def make_euroc(folder, sequence, resolution=(WIDTH, HEIGHT), distortion="[0.0, 0.0, 0.0, 0.0]",
               model="camera_model: pinhole\n"):
    for camera in (0, 1):
        place = os.path.join(folder, "mav0", f"cam{camera}")
        shutil.copytree(os.path.join(sequence, f"image_{camera}"), os.path.join(place, "data"))
        with open(os.path.join(place, "data.csv"), "w", encoding="ascii") as file:
            file.writelines(f"{100000000 * (i + 1)},{i:06d}.png\n" for i in range(FRAMES))
        with open(os.path.join(place, "sensor.yaml"), "w", encoding="ascii") as file:
            x = camera * BF / FX
            file.write(f"sensor_type: camera\n{model}distortion_model: radial-tangential\n"
                       f"distortion_coefficients: {distortion}\nresolution: {list(resolution)}\n"
                       f"intrinsics: [{FX}, {FX}, {WIDTH / 2}, {HEIGHT / 2}]\n"
                       f"T_BS:\n  cols: 4\n  rows: 4\n"
                       f"  data: [1.0, 0.0, 0.0, {x}, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, "
                       "0.0, 0.0, 0.0, 1.0]\n")


class Result:
    def __init__(self, status, out, err):
        self.status, self.out, self.err = status, out, err


class Programs:
    def __init__(self, folder):
        self.folder = folder

    def has(self, name):
        return os.path.exists(os.path.join(self.folder, name))

    def start(self, name, arguments, before=None, **more):
        def prepare():
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # Python ignores it
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # ignored by what a script starts with &
            signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored below nohup
            if before:
                before()
        return subprocess.Popen([os.path.join(self.folder, name), *arguments],
                                stdout=more.pop("stdout", subprocess.PIPE), stderr=subprocess.PIPE,
                                stdin=subprocess.DEVNULL, preexec_fn=prepare, **more)

    def finish(self, process, seconds=60):
        try:
            out, err = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise AssertionError(f"still running after {seconds} s") from None
        return Result(process.returncode, (out or b"").decode(errors="replace"),
                      err.decode(errors="replace"))

    def run(self, name, *arguments, **more):
        return self.finish(self.start(name, arguments, **more))

    def kitti(self, f, *arguments, **more):
        return self.run("run_stereo_kitti", f.sequence, "--output", f.output, "--quiet", *arguments,
                        **more)


def expect(condition, text):
    if not condition:
        raise AssertionError(text)


def lines(path):
    with open(path, encoding="utf-8") as file:
        return len(file.readlines())


def refused(result, *parts, status=2):
    """One line on stderr that has the parts in it."""
    expect(result.status == status, f"status {result.status} instead of {status}: {result.err}")
    expect(result.err.count("\n") == 1, f"not one line: {result.err!r}")
    expect("terminate" not in result.err, result.err)
    for part in parts:
        expect(part in result.err, f"{part!r} is not in {result.err!r}")


def passed(result):
    expect(result.status == 0, f"status {result.status}: {result.err}")


def complete(f, frames=FRAMES):
    for name in OUTPUTS:
        expect(os.path.isfile(os.path.join(f.output, name)), f"{name} is missing")
    got = lines(os.path.join(f.output, "frames.csv")) - 1
    expect(got == frames, f"{got} frames instead of {frames}")
    with open(os.path.join(f.output, "summary.json"), encoding="utf-8") as file:
        return json.load(file)


def saved(f, least):
    """A run that ended early has kept the frames it had."""
    expect(lines(os.path.join(f.output, "trajectory.kitti")) >= least, "frames are lost")
    return complete(f, lines(os.path.join(f.output, "trajectory.kitti")))


CASES = {}


def case(function):
    CASES[function.__name__] = function
    return function


def refusals(name, table):
    """Cases that differ in what is prepared and in the words of the refusal."""
    for key, (prepare, parts) in table.items():
        def check(f, programs, prepare=prepare, parts=parts):
            arguments = prepare(f) or []
            refused(programs.kitti(f, *arguments), *parts)
        CASES[f"{name}_{key}"] = check


@case
def sound_input_is_tracked(f, programs):
    passed(programs.kitti(f))
    summary = complete(f)
    expect(summary["frames_tracked"] == FRAMES, summary)
    expect(abs(summary["path_length_m"] - (FRAMES - 1) * 6 * BF / DISPARITY / FX) < 0.3, summary)


# --- files and folders ---------------------------------------------------------------------------

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


def as_nobody(more=lambda: None):
    """Without the rights of the administrator, who may read everything."""
    def before():
        more()
        if os.getuid() == 0:
            os.setgid(65534)
            os.setuid(65534)
    return before


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


# --- prior files ---------------------------------------------------------------------------------

def make_priors(f, programs, label_space="coco_panoptic_133", category=90, name=None):
    """Prior files of one class for every frame; `name`: of the label space, put in afterwards."""
    os.makedirs(f("classes"), exist_ok=True)
    for image in os.listdir(os.path.join(f.sequence, "image_0")):
        png(f("classes", image), [bytes([category]) * WIDTH] * HEIGHT)
    passed(programs.run("build_priors", f.sequence, "--semantic-left", f("classes"), "--output",
                        f("priors"), "--label-space", label_space, "--quiet"))
    for file in os.listdir(f("priors")):
        if name is None or not file.endswith(".kysp"):
            continue
        with open(f("priors", file), "rb+") as prior:
            data = bytearray(prior.read())
            data[48:80] = name.encode().ljust(32, b"\0")
            data[16:20] = struct.pack("<I", zlib.crc32(data[20:]))
            prior.seek(0)
            prior.write(data)


@case
def priors_with_labels_beyond_their_space(f, programs):
    validate = ["validate_priors", f("priors"), "--sequence", f.sequence]
    make_priors(f, programs)
    passed(programs.run(*validate))
    shutil.rmtree(f("priors"))
    make_priors(f, programs, name="my_own")
    result = programs.run(*validate)
    passed(result)
    expect(result.err.count("\n") == 1 and "my_own" in result.err, result.err)
    shutil.rmtree(f("priors"))
    make_priors(f, programs, name="cityscapes_19")
    result = programs.run(*validate)
    expect(result.status == 2, f"called sound: {result.out}")
    expect("000000.kysp: label 79 is not in label space cityscapes_19" in result.err, result.err)


@case
def priors_names_are_escaped(f, programs):
    for camera in (0, 1):
        for i in range(FRAMES):
            os.rename(f.image(i, camera),
                      f.image(i, camera).replace(f"{i:06d}", f"\x1b[2J\nsound {i:06d}"))
    make_priors(f, programs)
    result = programs.run("inspect_priors", f("priors"))
    passed(result)
    expect("\x1b" not in result.out and "\\x1b[2J\\nsound 000001.kysp" in result.out, result.out)
    for file in os.listdir(f("priors")):
        if file.endswith(".kysp"):
            with open(f("priors", file), "wb"):
                pass
    result = programs.run("validate_priors", f("priors"), "--sequence", f.sequence)
    expect(result.status == 2, f"status {result.status}")
    expect("\x1b" not in result.err and "\\x1b[2J\\nsound 000001.kysp" in result.err, result.err)


@case
def priors_compared_with_long_names(f, programs):
    """The rows keep all their fields, and a table that cannot be written is told first."""
    name = "n," + "x" * 180
    for camera in (0, 1):
        for i in range(FRAMES):
            os.rename(f.image(i, camera), f.image(i, camera).replace(f"{i:06d}", f"{name}{i:06d}"))
    make_priors(f, programs)
    compare = ["compare_priors", f("priors"), f("priors"), f.sequence, "--csv"]
    result = programs.run(*compare, "/proc/nope.csv")
    refused(result, "/proc/nope.csv")
    expect(result.out == "", "compared before the check")
    passed(programs.run(*compare, f("c.csv")))
    with open(f("c.csv"), encoding="utf-8") as file:
        rows = file.readlines()
    expect(len(rows) == 1 + 2 * FRAMES, len(rows))
    expect(all(row.startswith(f'"{name}') and row.count(",") == 9 for row in rows[1:]), rows[1])


@case
def objects_of_a_class_that_is_not_utf8(f, programs):
    head = ("frame,name,timestamp,instance,class,p_moving,keypoints,x,y,z,vx,vy,vz,sigma_v\n"
            "0,0,0,5,car,1,30,0,0,9,0,0,1,1\n")
    f.write("run/objects.csv", head)
    f.write("run/frames.csv", "index,name,timestamp\n" +
            "".join(f"{i},{i},{0.1 * i}\n" for i in range(20)))
    f.write("run/trajectory.kitti", "1 0 0 0 0 1 0 0 0 0 1 0\n" * 20)
    f.write("truth.txt", b"".join(b"%d 5 C\xff\x1b[2J 0 0 0 1 2 3 4 1.5 1.8 4.2 0 0 %.1f 0\n" %
                                  (i, 9 + i / 10) for i in range(20)))
    for more in ((), ("--json",)):
        result = programs.run("evaluate_objects", f("run"), "--truth", f("truth.txt"), *more)
        passed(result)
        expect("\x1b" not in result.out and "C\\xff" in result.out.replace("\\\\", "\\"), result.out)


# --- settings and options ------------------------------------------------------------------------

def config(text):
    return lambda f: ["--config", f.write("c.yaml", text)]


LAUGHS = "a: &a [x, x]\n" + "".join(f"{b}: &{b} [*{a}, *{a}, *{a}, *{a}, *{a}, *{a}]\n"
                                    for a, b in zip("abcdefghijk", "bcdefghijkl"))
refusals("settings", {
    "self_reference": (config("orb: &a\n  levels: *a\n"), ["c.yaml", "not allowed"]),
    "many_aliases": (config(LAUGHS), ["c.yaml", "not allowed"]),
    "deep": (config("[" * 3000), ["c.yaml"]),
    "deep_maps": (config("{a: " * 100 + "1" + "}" * 100), ["c.yaml", "too deeply"]),
    "tag": (config("orb: !thing\n  levels: 8\n"), ["c.yaml", "tag"]),
    "two_documents": (config("orb:\n  levels: 8\n---\norb:\n  levels: 7\n"), ["one document"]),
    "large": (config("# " + "x" * 2000000), ["c.yaml", "more than"]),
    "binary": (config(bytes(range(256))), ["c.yaml"]),
    "frames_0": (lambda f: ["--frames", "0"], ["--frames"]),
    "frames_huge": (lambda f: ["--frames", str(2**63)], ["--frames"]),
    "frames_negative": (lambda f: ["--frames", "-1"], ["--frames"]),
})


@case
def settings_build_priors_frames(f, programs):
    for frames in ("-1", "0", str(2**63), str(2**64)):
        refused(programs.run("build_priors", f.sequence, "--panoptic-left", f.sequence, "--output",
                             f.output, "--frames", frames), "--frames")


@case
def settings_outside_any_sense(f, programs):
    """The tables of ranges are tested setting by setting; here what the user sees of it."""
    shown = programs.run("run_stereo_kitti", "--list-settings")
    passed(shown)
    group, checked = "", 0
    for line in shown.out.splitlines():
        key = line.split(":")[0].strip()
        if line and not line.startswith(" "):
            group = key
        elif key and key[0] != "#" and " to " in line:
            checked += 1
            if checked % 8 == 0:  # a sample: every one starts the program
                for value in ("nan", "-1e30", "1e300"):
                    refused(programs.kitti(f, "--set", f"{group}.{key}={value}"), f"{group}.{key}")
    expect(checked > 80, f"{checked} settings with a range")
    for setting in ("mapping.scale_tolerance=0", "place.min_share=9", "orb.features=-1"):
        refused(programs.kitti(f, "--set", setting), setting.split("=")[0], "to")


@case
def settings_long_label_space(f, programs):
    name = f.write("c.yaml", "control:\n  label_space: " + "a" * 500000 + "\n")
    refused(programs.kitti(f, "--config", name), "control.label_space", "2000")


@case
def settings_lines_stay_one(f, programs):
    for arguments in (["--set", "orb.levels=1\n2"], ["--mode", "a\nb"], ["--config", "a\nb"],
                      ["--frames", "a\nb"], ["--fra\nmes", "3"], ["--load-map", "a\nb"]):
        refused(programs.kitti(f, *arguments), "\\n")


@case
def settings_of_the_builder(f, programs):
    for setting in ("drift.sigma=1e9", "drift.sigma=nan", "depth.max_depth=1e300",
                    "ego_motion.iterations=100000"):
        refused(programs.run("build_priors", f.sequence, "--panoptic-left", f.sequence, "--output",
                             f.output, "--set", setting), setting.split("=")[0])


@case
def settings_seed_of_the_simulator(f, programs):
    refused(programs.run("simulate_sequence", "street", "--output", f.output, "--seed",
                         "99999999999999999999"), "--seed")


@case
def settings_mode_that_is_named_stays(f, programs):
    """Priors choose a mode only where none is named."""
    os.mkdir(f("priors"))
    f.write("priors/none.kysp", "")  # of no frame of the sequence
    f.write("stock.yaml", "kys: {mode: stock}\n")
    for arguments, mode in (([], "verified"), (["--set", "kys.mode=stock"], "stock"),
                            (["--config", f("stock.yaml")], "stock"),
                            (["--mode", "kys", "--set", "kys.mode=stock"], "kys")):
        passed(programs.kitti(f, "--priors", f("priors"), "--overwrite", *arguments))
        expect(complete(f)["mode"] == mode, f"{arguments}: not {mode}")


@case
def settings_set_leaves_the_sequence(f, programs):
    passed(programs.run("run_stereo_kitti", "--set", "orb.levels=7", f.sequence, "--output",
                        f.output, "--quiet"))
    complete(f)


@case
def settings_not_a_number(f, programs):
    refused(programs.run("perturb_priors", "segments", f.sequence, "--output", f.output, "--share",
                         "nan"), "--share")
    refused(programs.run("perturb_priors", "flow", f.sequence, "--output", f.output, "--relative",
                         "nan"), "--relative")
    refused(programs.run("evaluate_trajectory", "--reference", f.path, "--estimate", f.path,
                         "--max-time-difference", "nan"), "--max-time-difference")


# --- calibrations and pairs ----------------------------------------------------------------------

def calibration(**values):
    return lambda f: write_calibration(f.sequence, **values)


def same_images(f):
    shutil.rmtree(os.path.join(f.sequence, "image_1"))
    shutil.copytree(os.path.join(f.sequence, "image_0"), os.path.join(f.sequence, "image_1"))


refusals("pair", {
    "absurd_focal_length": (calibration(fx=1e30), ["calib.txt", "focal length"]),
    "right_camera_above": (calibration(ty=100.0), ["calib.txt", "above or below"]),
    "left_is_right": (same_images, ["000000.png", "same picture"]),
})


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
    make_euroc(f("euroc"), f.sequence)
    refused(programs.run("run_stereo_euroc", f("euroc"), "--output", f("other"), "--load-map",
                         f("m.map")), "m.map", "another camera", "than this one")
    write_calibration(f.sequence, fx=FX * 1.01)
    refused(programs.kitti(f, "--load-map", f("m.map")), "m.map", "camera")


# --- outputs -------------------------------------------------------------------------------------

@case
def output_one_file_is_a_folder(f, programs):
    for name in ("frames.csv", "trajectory.tum"):
        shutil.rmtree(f.output, ignore_errors=True)
        os.makedirs(os.path.join(f.output, name))
        refused(programs.kitti(f, "--save-map", f("m.map")), name)
        for other in OUTPUTS:
            expect(other == name or os.path.isfile(os.path.join(f.output, other)), other)
        expect(os.path.isfile(f("m.map")), "the map is lost")


@case
def output_map_is_checked_first(f, programs):
    os.mkdir(f("folder"))
    for target in (f("folder"), f("missing", "m.map"), f("seq", "calib.txt", "m.map")):
        refused(programs.kitti(f, "--save-map", target), target)
        expect(not os.path.exists(os.path.join(f.output, "frames.csv")), "tracked before the check")
    expect(not [n for n in os.listdir(f.path) if n.startswith(".")], "left a temporary file")


@case
def output_map_in_a_locked_folder(f, programs):
    os.chmod(f.path, 0o777)
    os.mkdir(f("locked"), 0o555)
    refused(programs.kitti(f, "--save-map", f("locked", "m.map"), before=as_nobody()), "locked/m.map",
            "Permission denied")
    expect(not os.path.exists(os.path.join(f.output, "frames.csv")), "tracked before the check")


@case
def output_disk_is_full(f, programs):
    """The map on another disk is saved. Where nobody may mount, there is nothing to see."""
    os.mkdir(f.output)
    command = (f"mount -t tmpfs -o size=24k none '{f.output}' || exit 99; '{programs.folder}"
               f"/run_stereo_kitti' '{f.sequence}' --output '{f.output}' --quiet --save-map "
               f"'{f('m.map')}'; status=$?; cp -r '{f.output}' '{f('kept')}'; exit $status")
    if shutil.which("unshare") is None:
        return
    result = subprocess.run(["unshare", "-m", "sh", "-c", command], stderr=subprocess.PIPE, text=True,
                            check=False)
    if result.returncode in (1, 99) and not os.path.isdir(f("kept")):
        return
    refused(Result(result.returncode, "", result.stderr), "No space left")
    expect(os.path.getsize(f("m.map")) > 1000, "the map is lost")
    expect(lines(f("kept", "trajectory.kitti")) == FRAMES, "frames are lost")
    expect(not [n for n in os.listdir(f("kept")) if n.startswith(".")], "left files")


@case
def output_killed_while_writing(f, programs):
    """kill -9 at the worst moment, in a folder with an older run: what says it is complete, is."""
    passed(programs.kitti(f))
    complete(f)
    summary = os.path.join(f.output, "summary.json")
    killed = 0
    for delay in (0, 0.0003, 0.001, 0.002, 0.004):
        process = programs.start("run_stereo_kitti", [f.sequence, "--output", f.output, "--quiet",
                                                      "--frames", "6"])
        while os.path.exists(summary) and process.poll() is None:
            pass
        time.sleep(delay)
        process.kill()
        killed += programs.finish(process).status == -signal.SIGKILL
        if os.path.exists(summary):
            complete(f, 6)
        passed(programs.kitti(f))
        complete(f)
    expect(killed > 0, "never killed in time")
    for name in os.listdir(f.output):
        if name.startswith("."):
            os.utime(os.path.join(f.output, name), (time.time() - 100, time.time() - 100))
    passed(programs.kitti(f))
    expect(not [n for n in os.listdir(f.output) if n.startswith(".")], "left files")


@case
def output_map_goes_beside_the_rest(f, programs):
    os.mkdir(f("maps"))
    times = "".join(f"{i}\n" for i in range(FRAMES))
    f.write("seq/times.txt", times)
    process = programs.start("run_stereo_kitti", [f.sequence, "--output", f.output, "--quiet",
                                                  "--schedule", "realtime", "--save-map",
                                                  f("maps", "m.map")])
    time.sleep(2)
    shutil.rmtree(f("maps"))
    process.send_signal(signal.SIGINT)
    refused(programs.finish(process), "m.map", "saved.map")
    expect(os.path.getsize(os.path.join(f.output, "saved.map")) > 1000, "no map")


@case
def output_of_another_run(f, programs):
    passed(programs.kitti(f))
    passed(programs.kitti(f))  # the same again
    os.rename(f.sequence, f("other"))
    other = [f("other"), "--output", f.output, "--quiet"]
    refused(programs.run("run_stereo_kitti", *other), "another run", "--overwrite")
    passed(programs.run("run_stereo_kitti", *other, "--overwrite"))
    expect(complete(f)["sequence"] == "other", "not overwritten")


@case
def output_left_files_are_cleared(f, programs):
    os.mkdir(f.output)
    old = os.path.join(f.output, ".trajectory.tum.999-0.kys-tmp")
    with open(old, "w", encoding="ascii"):
        pass
    os.utime(old, (time.time() - 100, time.time() - 100))
    passed(programs.kitti(f))
    expect(not [n for n in os.listdir(f.output) if n.startswith(".")], "left files")


@case
def output_permissions_are_the_users(f, programs):
    passed(programs.kitti(f, before=lambda: os.umask(0o027)))
    mode = os.stat(os.path.join(f.output, "trajectory.tum")).st_mode & 0o777
    expect(mode == 0o640, oct(mode))


@case
def output_full_disk(f, programs):
    with open("/dev/full", "w", encoding="ascii") as full:
        result = programs.finish(programs.start("run_stereo_kitti", ["--list-settings"],
                                                stdout=full))
    refused(result, "standard output")


# --- limits --------------------------------------------------------------------------------------

def limit(kind, value):
    return lambda: resource.setrlimit(kind, (value, value))


@case
def limits_file_size(f, programs):
    result = programs.kitti(f, "--save-map", f("m.map"), before=limit(resource.RLIMIT_FSIZE, 8192))
    expect(result.status == 2, f"status {result.status}")
    expect("File too large" in result.err, result.err)
    expect(lines(os.path.join(f.output, "trajectory.kitti")) == FRAMES, "frames are lost")
    expect(not [n for n in os.listdir(f.output) if n.startswith(".")], "left files")


@case
def limits_memory(f, programs):
    for megabytes in [*range(80, 140, 4), *range(140, 420, 20)]:
        shutil.rmtree(f.output, ignore_errors=True)
        result = programs.kitti(f, before=limit(resource.RLIMIT_AS, megabytes << 20))
        # 127: the loader itself had no room.
        expect(result.status in (0, 2, 127), f"{megabytes} MB: {result.status}: {result.err}")
        expect(result.status != 2 or "memory" in result.err or "thread" in result.err or
               "resource" in result.err.lower(), f"{megabytes} MB: {result.err}")


@case
def limits_threads(f, programs):
    os.chmod(f.path, 0o777)
    # The search for leaks would need a thread of its own.
    result = programs.kitti(f, before=as_nobody(limit(resource.RLIMIT_NPROC, 1)),
                            env=dict(os.environ, ASAN_OPTIONS="detect_leaks=0"))
    expect(result.status in (0, 2), f"status {result.status}: {result.err}")
    expect(result.status == 0 or "cannot start a thread" in result.err, result.err)


def with_memory(megabytes):
    return dict(os.environ, KYS_MEMORY_MB=str(megabytes))


@case
def limits_memory_of_an_input(f, programs):
    """Refused by what it says it needs, before the machine finds out."""
    for camera in (0, 1):
        png(f.image(0, camera), [bytes(WIDTH)] * 8, 16384, 16384)
    write_calibration(f.sequence)
    big = programs.kitti(f)
    refused(big, "000000.png")
    side = 9000
    rows = [bytes(side)] * side
    png(f.image(0, 0), rows)
    refused(programs.kitti(f, env=with_memory(100)), "000000.png", "needs 162 MB of memory",
            "the limit is 100 MB", "KYS_MEMORY_MB")
    refused(programs.kitti(f, env=with_memory("much")), "KYS_MEMORY_MB", "'much'")


@case
def limits_memory_of_short_lines(f, programs):
    f.write("seq/times.txt", "1\n" * 1000000)
    refused(programs.kitti(f, env=with_memory(60)), "times.txt: needs 96 MB of memory",
            "the limit is 60 MB")


@case
def limits_memory_of_pairs_of_objects(f, programs):
    f.write("run/objects.csv", "frame,name,timestamp,instance,class,p_moving,keypoints,x,y,z,vx,vy,"
            "vz,sigma_v\n" + "".join(f"0,0,0,{i},car,1,30,0,0,9,0,0,0,1\n" for i in range(2000)))
    f.write("run/frames.csv", "index,name,timestamp\n0,0,0\n")
    f.write("run/trajectory.kitti", "1 0 0 0 0 1 0 0 0 0 1 0\n")
    f.write("run/ground_truth.tum", "0 0 0 0 0 0 0 1\n")
    f.write("truth.txt", "".join(f"0 {i} Car 0 0 0 1 2 3 4 1.5 1.8 4.2 0 0 9 0\n"
                                 for i in range(2000)))
    refused(programs.run("evaluate_objects", f("run"), "--truth", f("truth.txt"),
                         env=with_memory(100)), "frame 0", "needs 384 MB of memory")


@case
def limits_memory_in_use(f, programs):
    """The trajectory so far is saved when the limit is passed while tracking."""
    result = programs.kitti(f, env=with_memory(10))
    refused(result, "out of memory", "the limit is 10 MB")
    summary = saved(f, 1)
    expect("out of memory" in summary["end_reason"], summary)


@case
def limits_descriptors(f, programs):
    for count in range(3, 16):
        shutil.rmtree(f.output, ignore_errors=True)
        result = programs.kitti(f, before=limit(resource.RLIMIT_NOFILE, count))
        expect(result.status in (0, 2, 127), f"{count} descriptors: {result.status}: {result.err}")


@case
def limits_a_huge_image_in_the_middle(f, programs):
    png(f.image(7), [bytes(WIDTH)] * HEIGHT, 16384, 16384)
    refused(programs.kitti(f, before=limit(resource.RLIMIT_AS, 700 << 20)), "000007.png")
    saved(f, 7)


# --- signals -------------------------------------------------------------------------------------

def slow_run(f, programs, *arguments, before=None):
    """A run that waits for its second frame."""
    f.write("seq/times.txt", "".join(f"{1000 * i}\n" for i in range(FRAMES)))
    process = programs.start("run_stereo_kitti", [f.sequence, "--output", f.output, "--quiet",
                                                  *arguments], before=before)
    end = time.monotonic() + 20
    while not os.path.isdir(f.output) and time.monotonic() < end:
        time.sleep(0.01)
    time.sleep(2)
    expect(process.poll() is None, "ended by itself")
    return process


def saving_signal(number, *arguments):
    def check(f, programs):
        process = slow_run(f, programs, *arguments)
        begin = time.monotonic()
        process.send_signal(number)
        result = programs.finish(process, 30)
        expect(time.monotonic() - begin < 10, "waited")
        expect(result.status == 0, f"status {result.status}: {result.err}")
        summary = saved(f, 1)
        expect(summary["end_reason"] == "interrupted", summary)
    return check


for signal_name in ("SIGINT", "SIGTERM", "SIGHUP"):
    CASES[f"signals_{signal_name}_while_waiting"] = saving_signal(
        getattr(signal, signal_name), "--schedule", "realtime")
CASES["signals_SIGINT_in_a_stall"] = saving_signal(signal.SIGINT, "--set",
                                                   "control.stall_ms=60000")


@case
def signals_ignored_stay_ignored(f, programs):
    def ignore():
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    process = slow_run(f, programs, "--schedule", "realtime", before=ignore)
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGINT)
    time.sleep(1)
    expect(process.poll() is None, "ended by an ignored signal")
    process.send_signal(signal.SIGTERM)
    passed(programs.finish(process, 30))
    saved(f, 1)


@case
def signals_nobody_reads(f, programs):
    process = programs.start("run_stereo_kitti", [f.sequence, "--output", f.output])
    process.stdout.close()
    process.stdout = None
    passed(programs.finish(process))
    complete(f)


def run_case(name, programs, sequence, folder, failures):
    path = os.path.join(folder, name)
    os.mkdir(path)
    try:
        CASES[name](Folder(path, sequence), programs)
        error = None
    except AssertionError as problem:
        error = str(problem) or "without a message"
    except Exception as problem:  # pylint: disable=broad-except
        error = f"{type(problem).__name__}: {problem}"
    print(f"{'FAILED' if error else 'passed'}  {name}{': ' + error if error else ''}", flush=True)
    if error:
        failures.append(name)


def main():
    programs = Programs(os.path.abspath(sys.argv[1]))
    wanted = sys.argv[2:]
    names = [n for n in CASES if not wanted or any(w in n for w in wanted)]
    if os.environ.get("KYS_SANITIZE"):  # sanitizers need memory and descriptors of their own
        names = [n for n in names if n not in ("limits_memory", "limits_descriptors",
                                               "limits_a_huge_image_in_the_middle",
                                               "limits_memory_in_use")]
        if not programs.has("simulate_sequence"):
            names = [n for n in names if "simulator" not in n]
    failures = []
    with tempfile.TemporaryDirectory(prefix="kys_hostile_") as folder:
        os.chmod(folder, 0o755)
        sequence = os.path.join(folder, "sequence")
        make_sequence(sequence)
        for name in names:
            run_case(name, programs, sequence, folder, failures)
    print(f"{len(names) - len(failures)} of {len(names)} cases passed")
    return 1 if failures or not names else 0


if __name__ == "__main__":
    sys.exit(main())
