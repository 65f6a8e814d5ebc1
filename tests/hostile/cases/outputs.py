# SPDX-License-Identifier: BSD-3-Clause
"""Outputs that cannot be written."""
import json
import os
import shutil
import signal
import subprocess
import time

from harness import (FRAMES, FX, OUTPUTS, Result, as_nobody, case, complete, expect, lines, passed,
                     refused, write_calibration)


def read(path):
    with open(path, "rb") as file:
        return file.read()


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


@case
def output_standard_descriptors_are_closed(f, programs):
    """What is said is lost, and nothing of it is in a file."""
    for closed in ((0,), (1,), (2,), (0, 1, 2)):
        def close(closed=closed):
            for fd in closed:
                os.close(fd)
        shutil.rmtree(f.output, ignore_errors=True)
        passed(programs.run("run_stereo_kitti", f.sequence, "--output", f.output, before=close))
        summary = complete(f)
        expect(summary["complete"], summary)


@case
def output_map_without_keyframes(f, programs):
    """A run that ended before its first keyframe writes none."""
    with open(f.image(0), "r+b") as image:
        image.truncate(20)
    result = programs.kitti(f, "--save-map", f("m.map"))
    expect(result.status == 2, f"status {result.status}: {result.err}")
    for part in ("000000.png", "m.map: no map is written"):
        expect(part in result.err, f"{part!r} is not in {result.err!r}")
    expect(not os.path.exists(f("m.map")), "an empty map is written")


@case
def output_of_a_run_without_frames(f, programs):
    """It ends before its first keyframe: what an earlier run left is still there."""
    passed(programs.kitti(f, "--save-map", f("m.map")))
    kept = [f("m.map"), *(os.path.join(f.output, name) for name in OUTPUTS)]
    before = [read(path) for path in kept]
    with open(f.image(0), "r+b") as image:
        image.truncate(20)
    for more in ([], ["--overwrite"]):
        result = programs.kitti(f, "--save-map", f("m.map"), *more)
        expect(result.status == 2, f"status {result.status}: {result.err}")
        for part in ("000000.png", "m.map: no map is written", "the results in"):
            expect(part in result.err, f"{part!r} is not in {result.err!r}")
        for path, text in zip(kept, before):
            expect(read(path) == text, f"{path} was replaced")


@case
def output_is_the_input(f, programs):
    path = f.write("path.txt", "".join(f"1 0 0 0 0 1 0 0 0 0 1 {i}\n" for i in range(5)))
    refused(programs.run("simulate_features", path, "--output", path, "--quiet"), "is the input")
    features = f("path.features")
    passed(programs.run("simulate_features", path, "--output", features, "--quiet"))
    before = read(features)
    refused(programs.run("run_stereo_kitti", features, "--output", f.output, "--quiet", "--save-map",
                         features), "--save-map", "is the input")
    expect(read(features) == before, "the input is overwritten")


@case
def output_of_another_recording(f, programs):
    """Of the same name: told by the first frame and its time, where both are known."""
    def run(*more):
        return programs.run("run_stereo_kitti", f.sequence, "--output", f.output, "--quiet", *more)
    passed(run())
    passed(run("--frames", "6"))
    passed(run("--start", "3"))
    passed(run("--overwrite"))
    image = read(f.image(0, 0))
    shutil.copy(f.image(1, 0), f.image(0, 0))
    refused(run(), "another recording", "--overwrite")
    f.write("seq/image_0/000000.png", image)
    times = read(f("seq", "times.txt"))
    f.write("seq/times.txt", "".join(f"{5 + i}\n" for i in range(FRAMES)))
    refused(run(), "another recording", "--overwrite")
    summary = os.path.join(f.output, "summary.json")
    with open(summary, encoding="utf-8") as file:
        old = json.load(file)
    del old["recording"]
    f.write(summary, json.dumps(old))
    passed(run())
    f.write("seq/times.txt", times)
    passed(run("--overwrite"))
    write_calibration(f.sequence, fx=FX + 1)  # the same recording
    passed(run())


@case
def output_through_links(f, programs):
    """A link stays, what it leads to is written; also where it leads to nothing yet."""
    os.makedirs(f("far"))
    path = f.write("path.txt", "".join(f"1 0 0 0 0 1 0 0 0 0 1 {i}\n" for i in range(5)))
    os.mkdir(f.output)
    links = {f("m.map"): os.path.join("far", "a.map"), f("f.features"): f("far", "a.features"),
             os.path.join(f.output, "summary.json"): f("far", "a.json")}
    for link, target in links.items():
        os.symlink(target, link)
    for _ in range(2):
        passed(programs.kitti(f, "--save-map", f("m.map")))
        passed(programs.run("simulate_features", path, "--output", f("f.features"), "--quiet"))
        complete(f)
        for link, target in links.items():
            expect(os.path.getsize(f(target)) > 100, f"{target} is not written")
            expect(os.path.islink(link), f"{link} is no link any more")
    os.symlink("nothing", f("link"))
    passed(programs.run("run_stereo_kitti", f.sequence, "--output", f("link"), "--quiet"))
    expect(os.path.isfile(f("nothing", "summary.json")), "nothing is written where it leads")
    os.symlink("lo", f("lo"))
    refused(programs.kitti(f, "--save-map", f("lo")), "lo", "symbolic links")


@case
def output_of_the_simulator_through_a_link(f, programs):
    os.mkdir(f("far"))
    for name, target in (("link", "far"), ("new", "nothing")):
        os.symlink(target, f(name))
        passed(programs.run("simulate_sequence", "street", "--output", f(name), "--frames", "2", "--size",
                            "124x48", "--images-only", "--quiet"))
        expect(os.path.islink(f(name)), "the link is replaced")
        expect(os.path.isfile(f(target, "calib.txt")), "nothing is written where it leads")
