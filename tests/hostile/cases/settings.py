# SPDX-License-Identifier: BSD-3-Clause
"""Settings and options."""
import os

from harness import case, complete, expect, passed, refusals, refused


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


@case
def settings_seeds(f, programs):
    huge = "99999999999999999999999"
    for program, *arguments in (("perturb_priors", "segments", f.sequence),
                                ("perturb_priors", "decisions", f.sequence, "--case", "flip"),
                                ("simulate_features", f("seq", "times.txt"))):
        for seed in (huge, "-1", "1.5"):
            refused(programs.run(program, *arguments, "--output", f.output, "--seed", seed), "--seed", seed)


@case
def settings_that_contradict_each_other(f, programs):
    file = f.write("c.yaml", "orb: {fast_threshold: 5, fast_min_threshold: 9}\n")
    told = "orb.fast_threshold"
    refused(programs.kitti(f, "--config", file), "c.yaml", told)
    passed(programs.kitti(f, "--config", file, "--set", "orb.fast_threshold=20"))
    sound = f.write("sound.yaml", "orb: {levels: 7}\n")
    result = programs.kitti(f, "--config", sound, "--set", "orb.fast_threshold=5", "--set",
                            "orb.fast_min_threshold=9")
    refused(result, told)
    expect("sound.yaml" not in result.err, result.err)


@case
def settings_options_that_would_do_nothing(f, programs):
    build = ["build_priors", f.sequence, "--panoptic-left", f.sequence, "--output", f.output]
    refused(programs.run(*build, "--disparity-right", f.path), "--disparity-right", "--disparity;")
    refused(programs.run(*build, "--flow-right", f.path), "--flow-right", "--panoptic-right")
    refused(programs.run(*build, "--flow-back-left", f.path), "--flow-back-left", "--flow-left")
    refused(programs.run(*build, "--flow-left", "dis", "--flow-back-left", f.path),
            "--flow-back-left has no use")
    refused(programs.run(*build, "--disparity", "sgbm", "--disparity-right", f.path),
            "--disparity-right has no use")
    if programs.has("simulate_sequence"):
        refused(programs.run("simulate_sequence", "hall", "--output", f.output, "--drop-share", "0.2"),
                "--drop-share", "--drop-camera")
    path = f.write("path.txt", "".join(f"1 0 0 0 0 1 0 0 0 0 1 {i}\n" for i in range(5)))
    simulate = ("simulate_features", path, "--output", f("f.features"), "--quiet")
    refused(programs.run(*simulate, "--perception", "exact,poor"), "--perception", "--output")
    refused(programs.run(*simulate, "--output", f("g.features")), "--perception", "--output")
    refused(programs.run(*simulate, "--perception", "exact,poor", "--output", f("f.features")),
            "f.features", "twice")
    refused(programs.run(*simulate, "--perception", "none,poor", "--output", f("g.features")), "none")
    refused(programs.run(*simulate, "--perception", "exact,bad", "--output", f("g.features")),
            "--perception", "estimated")
    expect(not os.path.exists(f("f.features")), "a refused command writes a file")
    passed(programs.run(*simulate))
    run = ["run_stereo_kitti", f("f.features"), "--output", f.output, "--quiet"]
    refused(programs.run(*run, "--pair", "grey"), "f.features", "camera pairs")
    refused(programs.run(*run, "--strict-priors"), "--strict-priors", "--priors")
