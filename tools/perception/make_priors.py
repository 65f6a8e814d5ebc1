# SPDX-License-Identifier: BSD-3-Clause
"""From the images of a stereo sequence to prior files, in one command.

    make_priors.py SEQUENCE --model NETWORK.yaml --output DIR [--weights FILE.onnx] \\
        [--stereo-model STEREO.yaml] [--flow-model FLOW.yaml] [--builder PATH/build_priors] \\
        [--frames N] [--networks-only] [-- further arguments of build_priors]

Segments both images of the pair that is tracked (image_0 and image_1 where the sequence has them,
else image_2 and image_3), builds the prior files with disparity, flow and stereo keypoints from the
images, and validates them. Disparity and flow are by networks (fields_onnx.py) where their YAML files
are given, else sgbm and dis. What is there already is kept if it was made of the same images, network
and settings. DIR/times.json has seconds per stage, for kept files as measured when they were made.
DIR/decisions.html shows with pictures which objects were judged to move, and why (decision_page.py).
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import common  # noqa: E402
import fields_onnx  # noqa: E402
import segment_onnx  # noqa: E402
from onnx_network import add_jobs  # noqa: E402

ROBUST = Path(__file__).resolve().parents[2] / "configs" / "priors_robust.yaml"
SIDES = ("left", "right")
# What the networks of --stereo-model and --flow-model give, and the estimates without them.
FIELDS = {"stereo": "disparity", "flow": "flow"}
CLASSICAL = {"stereo": "sgbm", "flow": "dis"}


def program(given, name):
    """A program of this project: as given, beside the given one, in the build tree, in the path."""
    root = Path(__file__).resolve().parents[2]
    for candidate in (given, root / "build" / "release" / "bin" / name, shutil.which(name)):
        if candidate and Path(candidate).is_file():
            return str(candidate)
    common.fail(f"{name}: not found; build it, or give --builder")


def run(arguments):
    """Standard output of a program; ends with its exit status when that is not 0."""
    done = subprocess.run(arguments, stdout=subprocess.PIPE, text=True, check=False)
    print(done.stdout, end="", flush=True)
    if done.returncode != 0:
        sys.exit(done.returncode)
    return done.stdout


def timed(arguments):
    start = time.perf_counter()
    said = run(arguments)
    return time.perf_counter() - start, said


def time_of_build(command, times_file):
    """Runs build_priors; s for the files there are now, those of earlier runs included."""
    seconds, said = timed(command)
    counts = re.search(r"\((\d+) built, (\d+) kept\)", said)
    if counts is None:
        common.fail(f"{command[0]}: does not say what it built")
    built, kept = (int(n) for n in counts.groups())
    try:
        earlier = float(json.loads(times_file.read_text(encoding="utf-8"))["build"])
    except (OSError, ValueError, KeyError, TypeError):
        earlier = 0.0
    return (seconds if built else 0.0) + (earlier if kept else 0.0)


def parse_arguments():
    """Options, and what is after "--" for build_priors."""
    arguments, further = sys.argv[1:], []
    if "--" in arguments:
        at = arguments.index("--")
        arguments, further = arguments[:at], arguments[at + 1:]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sequence", type=Path)
    parser.add_argument("--model", required=True, help="YAML file of the network")
    parser.add_argument("--weights", help="ONNX file (default: what the YAML file names)")
    for name, kind in FIELDS.items():
        parser.add_argument(f"--{name}-model",
                            help=f"YAML file of a network for {kind} (default: none, {CLASSICAL[name]})")
        parser.add_argument(f"--{name}-weights",
                            help="its ONNX file (default: what its YAML file names)")
    parser.add_argument("--output", required=True, type=Path)
    parser.add_argument("--builder", help="path of the program build_priors")
    parser.add_argument("--pair", default="", choices=tuple(common.PAIRS),
                        help="image_0 and image_1 (default if they exist), or image_2 and "
                        "image_3; run_stereo_kitti needs the same")
    parser.add_argument("--threshold", type=float, help="least score (instances) or probability "
                        "(semantic) of a thing (default: output.min_score; 0.5 and 0)")
    parser.add_argument("--frames", type=common.whole(1), help="number of frames (default: all)")
    add_jobs(parser)
    parser.add_argument("--overwrite", action="store_true", help="replace existing outputs")
    parser.add_argument("--networks-only", action="store_true", help="no prior files: the outputs of the "
                        "networks and their times")
    return parser.parse_args(arguments), further


def field_networks(options):
    """Networks for stereo and flow by name, those whose YAML files are given."""
    networks = {}
    for name, kind in FIELDS.items():
        model, weights = (getattr(options, f"{name}_{what}") for what in ("model", "weights"))
        if model:
            networks[name] = fields_onnx.FieldNetwork(model, weights, kind)
        elif weights:
            common.fail(f"--{name}-weights needs --{name}-model")
    return networks


def field_arguments(networks, output):
    """Arguments of build_priors for disparity and flow."""
    arguments = ["--disparity", CLASSICAL["stereo"]]
    if "stereo" in networks:
        left, right = (str(output / "disparity" / side) for side in SIDES)
        arguments = ["--disparity", left, "--disparity-right", right]
    for side in SIDES:
        if "flow" in networks:
            arguments += [f"--flow-{side}", str(output / "flow" / side),
                          f"--flow-back-{side}", str(output / "flow_back" / side)]
        else:
            arguments += [f"--flow-{side}", CLASSICAL["flow"]]
    return arguments


def segment(network, images, options):
    """Panoptic maps of both cameras, from their lists of images. Entries of times.json."""
    times = dict.fromkeys(("network", "segments", "segmented images"), 0)
    for side, files in zip(SIDES, images):
        made = segment_onnx.segment_folder(network, files, options.output / "panoptic" / side,
                                           options.overwrite, f"segmentation {side}", options.jobs)
        for stage in ("network", "segments"):
            times[stage] += made[stage]
        times["segmented images"] += len(files)
    return times


def make_fields(networks, images, pairs, options):
    """Disparity and flow of both cameras by those networks that are given. Entries of times.json."""
    output, times = options.output, {}
    how = {"overwrite": options.overwrite, "jobs": options.jobs}
    if "stereo" in networks:
        made = fields_onnx.make_disparity(networks["stereo"], pairs,
                                          *(output / "disparity" / side for side in SIDES), **how)
        times.update({"stereo": made["seconds"], "stereo fields": made["fields"]})
    if "flow" in networks:
        both = [fields_onnx.make_flow(networks["flow"], files, output / "flow" / side,
                                      output / "flow_back" / side, label=f"flow {side}", **how)
                for side, files in zip(SIDES, images)]
        times.update({"flow": sum(made["seconds"] for made in both),
                      "flow fields": sum(made["fields"] for made in both)})
    return times


def copy_label_space(network, output):
    """The two files of a label space that is not built in, beside the prior files: programs find them
    there."""
    space = Path(network.label_space)
    for ending in (".classes.csv", ".table.csv"):
        file = space.with_name(space.name + ending)
        if file.exists():
            shutil.copyfile(file, output / file.name)


def write_page(options, priors):
    """DIR/decisions.html: what was judged and why. There is none where nothing was judged."""
    page = options.output / "decisions.html"
    page.unlink(missing_ok=True)
    made = subprocess.run([sys.executable, str(Path(__file__).with_name("decision_page.py")), str(priors),
                           str(options.sequence), "--output", str(page),
                           *(["--pair", options.pair] if options.pair else [])], check=False)
    print(f"decisions: {page}" if made.returncode == 0 else "no page of decisions, as said above")


def print_times(times):
    images = times["segmented images"]
    fields = "".join(f"{name} {1e3 * times[name] / max(1, times[f'{name} fields']):.0f} ms per {kind} "
                     "field, " for name, kind in FIELDS.items() if name in times)
    print(f"network {1e3 * times['network'] / images:.0f} ms and segments "
          f"{1e3 * times['segments'] / images:.0f} ms per image, {fields}build {times['build']:.1f} s, "
          f"validate {times['validate']:.1f} s")


def main():
    options, further = parse_arguments()
    common.need("onnxruntime", "yaml", "cv2")
    builder = program(options.builder, "build_priors")
    if not options.networks_only:
        validator = program(str(Path(builder).with_name("validate_priors")), "validate_priors")

    folders = common.image_pair(options.sequence, options.pair)
    if not folders[1].is_dir():
        common.fail(f"{folders[1]}: is not a folder")
    network = segment_onnx.Network(options.model, options.weights, options.threshold)
    networks = field_networks(options)
    panoptic = [options.output / "panoptic" / side for side in SIDES]
    priors = options.output / "priors"
    which = ["--pair", options.pair] if options.pair else []
    which += ["--frames", str(options.frames)] if options.frames else []
    build = [builder, str(options.sequence), "--output", str(priors),
             "--panoptic-left", str(panoptic[0]), "--panoptic-right", str(panoptic[1]),
             "--label-space", network.label_space, *field_arguments(networks, options.output),
             "--jobs", str(options.jobs), "--flow", "keypoints", "--config", str(ROBUST), *which,
             *(["--rebuild"] if options.overwrite else []), *further]
    # Before the hours that the networks take. The folders need not exist for it.
    run([*build, "--check"])
    images = [common.list_images(folder)[:options.frames] for folder in folders]
    pairs = common.partners(*images) if "stereo" in networks else []
    times = segment(network, images, options)
    times.update(make_fields(networks, images, pairs, options))
    times_file = options.output / "times.json"
    if options.networks_only:
        common.write_atomic(times_file, json.dumps(times, indent=2).encode("ascii"))
        return
    times["build"] = time_of_build(build, times_file)
    times["validate"], _ = timed([validator, str(priors), "--sequence", str(options.sequence),
                                  "--label-space", network.label_space, *which])
    copy_label_space(network, options.output)
    write_page(options, priors)
    print_times(times)
    common.write_atomic(times_file, json.dumps(times, indent=2).encode("ascii"))


if __name__ == "__main__":
    common.run(main)
