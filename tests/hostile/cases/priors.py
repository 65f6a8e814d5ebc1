# SPDX-License-Identifier: BSD-3-Clause
"""Prior files."""
import csv
import json
import os
import shutil
import struct
import zlib

from harness import FRAMES, HEIGHT, WIDTH, case, expect, passed, png, refused


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


def copy_label_space(f, name, change=lambda text: text):
    """A label space of one's own: COCO's with other text."""
    data = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "..", "kys", "data")
    for ending in (".classes.csv", ".table.csv"):
        with open(os.path.join(data, "coco_panoptic_133" + ending), encoding="utf-8") as file:
            f.write(name + ending, change(file.read()) if "classes" in ending else file.read())
    return f(name)


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
def priors_of_some_frames(f, programs):
    """The options of build_priors that choose frames, in validate_priors too."""
    make_priors(f, programs)
    os.remove(f("priors", "000000.kysp"))
    validate = ["validate_priors", f("priors"), "--sequence", f.sequence]
    expect(programs.run(*validate).status == 2, "a file is missing")
    passed(programs.run(*validate, "--start", "1", "--frames", str(FRAMES - 1)))
    expect(programs.run(*validate, "--frames", "1").status == 2, "the file is missing")
    refused(programs.run(*validate, "--start", str(FRAMES)), "--start is beyond the last frame")


@case
def priors_are_not_built_by_a_check(f, programs):
    check = ["build_priors", f.sequence, "--panoptic-left", f("later"), "--output", f("out"), "--check"]
    passed(programs.run(*check))
    expect(not os.path.exists(f("out")), "the folder was made")
    refused(programs.run(*check, "--label-space", f("no_such")), "no_such.classes.csv")
    refused(programs.run(*check, "--flow", "keypoints"), "detection.method robust only")


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
    f.write("run/frames.csv", "index,name,timestamp,status,submap\n" +
            "".join(f"{i},{i},{0.1 * i},tracked,0\n" for i in range(20)))
    f.write("run/trajectory.kitti", "1 0 0 0 0 1 0 0 0 0 1 0\n" * 20)
    f.write("truth.txt", b"".join(b"%d 5 C\xff\x1b[2J 0 0 0 1 2 3 4 1.5 1.8 4.2 0 0 %.1f 0\n" %
                                  (i, 9 + i / 10) for i in range(20)))
    for more in ((), ("--json",)):
        result = programs.run("evaluate_objects", f("run"), "--truth", f("truth.txt"), *more)
        passed(result)
        expect("\x1b" not in result.out and "C\\xff" in result.out.replace("\\\\", "\\"), result.out)


@case
def priors_of_a_label_space_given_as_a_path(f, programs):
    make_priors(f, programs)
    copy_label_space(f, "coco_panoptic_133")
    passed(programs.run("validate_priors", f("priors"), "--sequence", f.sequence, "--label-space",
                        f("coco_panoptic_133")))


@case
def priors_of_a_label_space_of_ones_own(f, programs):
    """The programs look it up where they are told, and nowhere else."""
    own = copy_label_space(f, "own", lambda text: text.replace(",car\n", ",carriage\n"))
    make_priors(f, programs, label_space=own, category=3)
    inspect = ["inspect_priors", f("priors")]
    passed(programs.run(*inspect))
    expect("carriage" in programs.run(*inspect, "--label-space", own).out, "no names")
    refused(programs.run(*inspect, "--label-space", f("wrong")), "wrong")
    perturb = ["perturb_priors", "decisions", f("priors"), "--output", f("parked"), "--case", "parked"]
    refused(programs.run(*perturb, "--label-space", "cityscapes_19"), "000000.kysp", "cityscapes_19")
    passed(programs.run(*perturb, "--label-space", own))


@case
def priors_segments_of_other_category_ids(f, programs):
    """The names of the JSON decide about categories, as in build_priors."""
    os.mkdir(f("pan"))
    png(f("pan", "0.png"), [bytes(8)] * 8)
    document = {"annotations": [{"file_name": "0.png", "segments_info":
                                 [{"id": i, "category_id": 901 + i % 3} for i in range(1, 90)]}],
                "categories": [{"id": 901, "name": "car"}, {"id": 902, "name": "person"},
                               {"id": 903, "name": "road"}]}
    perturb = ["perturb_priors", "segments", f("pan"), "--output", f("out"), "--share", "1"]
    f.write("pan.json", json.dumps(document))
    result = programs.run(*perturb)
    passed(result)
    expect("of 59 thing segments" in result.out, result.out)
    del document["categories"]
    f.write("pan.json", json.dumps(document))
    refused(programs.run(*perturb), "pan.json: category 902 is not in label space coco_panoptic_133")


@case
def objects_of_classes_with_commas_and_quotes(f, programs):
    """They are one field of objects.csv, as other programs read it."""
    path = f.write("path.txt", "".join(f"1 0 0 0 0 1 0 0 0 0 1 {i}\n" for i in range(40)))
    passed(programs.run("simulate_features", path, "--output", f("f.features"), "--quiet", "--traffic",
                        "jam", "--perception", "exact", "--seed", "2"))
    own = copy_label_space(f, "coco_panoptic_133",
                           lambda text: text.replace(",truck\n", ',truck, the "big" one\n'))
    passed(programs.run("run_stereo_kitti", f("f.features"), "--output", f.output, "--quiet", "--set",
                        f"control.label_space={own}"))
    with open(os.path.join(f.output, "objects.csv"), encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    expect({len(row) for row in rows} == {14}, "rows of other lengths")
    expect(any(row[4] == 'truck, the "big" one' for row in rows), {row[4] for row in rows})
