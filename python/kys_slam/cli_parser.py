# SPDX-License-Identifier: BSD-3-Clause
"""Commands and options of kys-slam, and the checks of their values."""

import argparse
import math
from typing import Tuple

import kys_slam
from kys_slam.cli_errors import BAD_INPUT
from kys_slam.live import POLICIES

_DESCRIPTION = """Stereo visual SLAM on any stereo recording.

  kys-slam run SEQUENCE                                  KITTI, Virtual KITTI 2, EuRoC, TUM-VI
  kys-slam run left.mp4 right.mp4 --calibration camchain.yaml
  kys-slam run left/ right/ --calibration camchain.yaml --rate 20
  kys-slam run recording.bag                             ROS 1, ROS 2, MCAP
  kys-slam run recording.bag --view                      shows observations and map while it runs
  kys-slam check SEQUENCE                                how well its pairs are rectified
  kys-slam features SEQUENCE --features MODEL.yaml       distances of a network's descriptors
  kys-slam calibrate RECORDING ... --from camchain.yaml -o refined.yaml
  kys-slam map info RUN.map                              and refine, evaluate, merge
  kys-slam evaluate RUN
  kys-slam plot RUN [RUN ...]
  kys-slam report RUN [RUN ...]                          one HTML page of several runs
"""


# Values of options: a value outside its range is rejected, with the option's name.

def _whole(low: int):
    def whole_number(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) < 2**31:
            raise argparse.ArgumentTypeError(f"'{text}' is no whole number from {low} to {2**31 - 1}")
        return int(text)
    return whole_number


def _number(low: float, high: float, exclusive: bool = True):
    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (low < value if exclusive else low <= value) or value > high:
            raise argparse.ArgumentTypeError(
                f"'{text}' is no number {'above' if exclusive else 'from'} {low:g} to {high:g}")
        return value
    return number


def _size(text: str) -> Tuple[int, int]:
    sides = text.lower().split("x")
    if len(sides) != 2 or not all(s.isdecimal() and 0 < int(s) <= 16384 for s in sides):
        raise argparse.ArgumentTypeError(f"'{text}' is no size: WxH, each 1 to 16384 px")
    return int(sides[0]), int(sides[1])


def _add_input(p: argparse.ArgumentParser):
    """The recording and its cameras. Returns the group of the camera's options."""
    p.add_argument("input", nargs="+", metavar="INPUT", help="one path, or LEFT and RIGHT")
    camera = p.add_argument_group("camera")
    camera.add_argument("--calibration", nargs="+", metavar="FILE",
                        help="Kalibr camchain, OpenCV stereo calibration, our YAML, or the "
                        "camera_info files of the left and the right camera; of a sequence that brings "
                        "its own: a correction of it (kys-slam calibrate)")
    camera.add_argument("--calibration-unit", type=_number(0, 1e6), metavar="M",
                        help="metres per unit of the calibration's lengths (mm: 0.001)")
    camera.add_argument("--rate", type=_number(0, 1e5), metavar="HZ",
                        help="frames per second, where the recording does not say")
    camera.add_argument("--times", default="", metavar="FILE", help="time stamps, s, one per image")
    camera.add_argument("--topics", nargs=2, metavar=("LEFT", "RIGHT"), help="image topics of a bag")
    camera.add_argument("--tolerance", type=_number(0, 3600, exclusive=False), metavar="S",
                        help="largest time difference of images that are paired by time (default: "
                        "0.003 for folders, 0.01 for bags)")
    camera.add_argument("--pair", default="", choices=("grey", "colour"),
                        help="of a KITTI odometry sequence: image_0 and image_1 (default if they "
                        "exist), or image_2 and image_3 (default with --segment)")
    return camera


def _add_features(group) -> None:
    group.add_argument("--features", metavar="MODEL.yaml",
                       help="a network for keypoints and descriptors in place of ORB (docs/features.md)")
    group.add_argument("--features-weights", metavar="FILE.onnx",
                       help="with --features: its ONNX file (default: what MODEL.yaml names)")
    group.add_argument("--features-count", type=_whole(1), metavar="N",
                       help="with --features: keypoints per image (default: what MODEL.yaml says)")
    group.add_argument("--features-threads", type=_whole(1), default=1, metavar="T",
                       help="with --features: threads of the network (default: 1)")


def _add_run(commands) -> None:
    p = commands.add_parser(
        "run", help="track a recording",
        description="Tracks a recording: a sequence folder (KITTI odometry or Tracking, Virtual "
        "KITTI 2, EuRoC, TUM-VI), two folders of images, two videos, one video of both images side "
        "by side, a ROS bag, or a feature file. The content of the input decides its kind.")
    camera = _add_input(p)
    camera.add_argument("--no-check", action="store_true",
                        help="do not check whether the pair is swapped or not rectified")
    slam = p.add_argument_group("tracking")
    slam.add_argument("--priors", metavar="DIR", help="prior files of this recording")
    slam.add_argument("--strict-priors", action="store_true",
                      help="with --priors: a missing prior file is an error")
    slam.add_argument("--segment", metavar="MODEL.yaml|DIR",
                      help="a segmentation network beside the tracker (docs/guide.md), or prior files of "
                      "--save-priors in its place")
    slam.add_argument("--segment-weights", metavar="FILE.onnx",
                      help="with --segment: its ONNX file (default: what MODEL.yaml names)")
    slam.add_argument("--segment-every", type=_whole(1), metavar="N",
                      help="with --segment: every N-th frame (default: 1; with --schedule realtime as many "
                      "as the network can)")
    slam.add_argument("--segment-lag", type=_whole(0), metavar="K",
                      help="with --segment: segments take effect K frames after their own (default: 0); not "
                      "with --schedule realtime")
    slam.add_argument("--segment-provider", metavar="NAME",
                      help="with --segment: what runs the network: cpu, cuda, tensorrt, openvino, coreml or "
                           "directml (default: what MODEL.yaml says, else the first there is)")
    slam.add_argument("--segment-threads", type=_whole(1), default=1, metavar="T",
                      help="with --segment: threads of the network (default: 1)")
    slam.add_argument("--save-priors", metavar="DIR",
                      help="with --segment: write the segments as prior files")
    _add_features(slam)
    slam.add_argument("--masks", metavar="DIR",
                      help="8-bit PNG files, 0 = use: DIR/left/NAME.png and DIR/right/NAME.png; with "
                      "DIR/classes.txt they are priors (docs/guide.md)")
    slam.add_argument("--mask", nargs="+", metavar="FILE",
                      help="8-bit PNG of what no frame uses (the robot itself), 0 = use: of the left "
                      "camera, or of both")
    slam.add_argument("--mode", help="matching mode:  " + ", ".join(kys_slam.modes()) +
                      " (default: verified with priors, stock without)")
    slam.add_argument("--kind", choices=("driving", "indoor"),
                      help="defaults of the settings (default: by the recording)")
    slam.add_argument("--config", metavar="FILE", help="YAML file of settings")
    slam.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings",
                      help="one setting, may be repeated; kys-slam settings lists them")
    slam.add_argument("--schedule", default="pipelined",
                      choices=("pipelined", "sequential", "realtime"))
    slam.add_argument("--late", default="wait", choices=POLICIES, metavar="POLICY",
                      help="with --schedule realtime: policy for frames that arrive faster than "
                      "they are tracked: wait (default), drop-oldest, drop-newest")
    slam.add_argument("--queue", type=_whole(1), default=2, metavar="N",
                      help="with --late: frames that may wait (default: 2)")
    slam.add_argument("--speed", type=_number(0, 1e6), default=1, metavar="X",
                      help="with --schedule realtime: play X times as fast as recorded")
    slam.add_argument("--start", type=_whole(0), default=0, metavar="N", help="first frame")
    slam.add_argument("--frames", type=_whole(1), metavar="N", help="number of frames")
    slam.add_argument("--load-map", metavar="FILE", help="continue with this map")
    slam.add_argument("--save-map", metavar="FILE", help="write the map at the end")
    slam.add_argument("--localize-only", action="store_true", help="do not change the map")
    out = p.add_argument_group("output")
    out.add_argument("--output", metavar="DIR", help="default: runs/NAME-MODE")
    out.add_argument("--overwrite", action="store_true", help="allow an output folder with another run")
    out.add_argument("--view", action="store_true",
                     help="show the observations while it runs (needs rerun-sdk)")
    out.add_argument("--record", action="append", default=[], metavar="FILE",
                     help="record the observations to FILE.rrd (Rerun) or FILE.mcap (Foxglove); may "
                     "be repeated")
    out.add_argument("--quiet", action="store_true", help="no progress, no table")


def _add_check(commands) -> None:
    p = commands.add_parser(
        "check", help="how well the pairs of a recording are rectified",
        description="Measures by how much rows differ between left and right images, over the image: "
        "zero for a rectified pair with a right calibration. Takes what `run` takes; no motion is "
        "needed. With a calibration that has a correction in it, what that leaves is measured. Exit status 0 whatever the result, 3 when too few matches are found to tell.")
    _add_input(p)
    p.add_argument("--start", type=_whole(0), default=0, metavar="N", help="first frame")
    p.add_argument("--frames", type=_whole(1), default=5, metavar="N",
                   help="number of pairs measured, spread over a sequence of images; of videos and bags "
                   "every tenth frame from the first one on (default: 5)")
    p.add_argument("--plot", metavar="FILE.png", help="draw the differences over the first left image")
    p.add_argument("--overwrite", action="store_true", help="replace an existing FILE.png")
    p.add_argument("--json", action="store_true")


def _add_measure(commands) -> None:
    p = commands.add_parser(
        "features", help="distances of the descriptors of a network for features",
        description="Measures how far descriptors of the same point and of different points are apart, on "
        "stereo pairs and frames of a recording, and prints the quantiles by which limits tuned for ORB "
        "become those of the network (docs/features.md). Without --features: those of ORB.")
    _add_input(p)
    _add_features(p)
    p.add_argument("--start", type=_whole(0), default=0, metavar="N", help="first frame")
    p.add_argument("--frames", type=_whole(1), default=40, metavar="N",
                   help="number of frames (default: 40)")
    p.add_argument("--write", action="store_true", help="write them into MODEL.yaml as well")


def _add_calibrate(commands) -> None:
    p = commands.add_parser(
        "calibrate", help="refine a calibration by recordings; show or convert one",
        description="With recordings of one rig: runs each, estimates from their maps how the cameras "
        "differ from the given calibration (the program calibrate_rig), and writes a calibration that "
        "--calibration of kys-slam run takes. With calibration files: shows the calibration after "
        "rectification, and writes it as our YAML.")
    p.add_argument("files", nargs="+", metavar="RECORDING|FILE",
                   help="recordings as kys-slam run takes them, pairs as LEFT,RIGHT; or the files of one "
                   "calibration")
    p.add_argument("--from", nargs="+", metavar="FILE", dest="given",
                   help="the given calibration of the recordings (those of a known layout bring it)")
    p.add_argument("-o", "--output", metavar="FILE", help="write it as our YAML, lengths in m")
    p.add_argument("--overwrite", action="store_true", help="replace an existing FILE")
    p.add_argument("--calibration-unit", type=_number(0, 1e6), default=1, metavar="M",
                   help="metres per unit of the calibration's lengths (mm: 0.001)")
    p.add_argument("--size", type=_size, metavar="WxH", help="size of the images, for files without it")
    of = p.add_argument_group("recordings")
    of.add_argument("--rate", type=_number(0, 1e5), metavar="HZ")
    of.add_argument("--topics", nargs=2, metavar=("LEFT", "RIGHT"))
    of.add_argument("--tolerance", type=_number(0, 3600, exclusive=False), metavar="S")
    of.add_argument("--pair", default="", choices=("grey", "colour"))
    of.add_argument("--kind", choices=("driving", "indoor"))
    of.add_argument("--frames", type=_whole(1), metavar="N", help="of each recording at most")
    of.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings")
    of.add_argument("--schedule", default="pipelined", choices=("pipelined", "sequential"))
    of.add_argument("--hold-out", type=_number(0, 0.5, exclusive=False), default=0.1, metavar="SHARE",
                    help="share of the observations that are predicted, not used (default: 0.1)")
    of.add_argument("--json", metavar="FILE", help="write the figures to FILE")


class _Parser(argparse.ArgumentParser):
    def error(self, message: str):
        self.exit(BAD_INPUT, f"{self.prog}: {' '.join(message.split())}; see --help\n")


def make_parser() -> argparse.ArgumentParser:
    """The parser; `command` of what it returns is the name of the command."""
    parser = _Parser("kys-slam", description=_DESCRIPTION,
                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", action="version", version=f"KYS-SLAM {kys_slam.__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    _add_run(commands)
    _add_check(commands)
    _add_measure(commands)

    p = commands.add_parser("evaluate", help="errors of a run, or of a trajectory, in figures")
    p.add_argument("estimate", metavar="RUN|FILE", help="folder of a run, or a TUM file")
    p.add_argument("--reference", metavar="FILE",
                   help="TUM file of the same camera (default: the run's ground_truth.tum)")
    p.add_argument("--align", default="se3", choices=("se3", "sim3", "none"))
    p.add_argument("--json", action="store_true")

    p = commands.add_parser("plot", help="paths and errors of one or several runs over ground truth")
    p.add_argument("runs", nargs="+", metavar="RUN", help="folders of runs, or TUM files")
    p.add_argument("--reference", metavar="FILE",
                   help="TUM file of the same camera (default: each run's ground_truth.tum)")
    p.add_argument("--align", default="se3", choices=("se3", "sim3", "none"))
    p.add_argument("--output", metavar="FILE",
                   help="default: paths.png in the folder of the run; of several runs in this folder")

    p = commands.add_parser("report", help="one HTML page of one or several runs")
    p.add_argument("runs", nargs="+", metavar="RUN", help="folders of runs")
    p.add_argument("--output", metavar="FILE",
                   help="default: report.html in the folder of the run; of several runs in this folder")

    p = commands.add_parser("view", help="shows a recording (--record) in Rerun's viewer")
    p.add_argument("file", metavar="FILE|RUN", help=".rrd, .mcap, map.ply, or a run's folder")

    _add_calibrate(commands)

    p = commands.add_parser(
        "map", help="show, refine, evaluate or merge saved maps", add_help=False,
        description="Calls map_info, refine_map, evaluate_map or merge_maps with what follows "
        "(docs/maps.md); kys-slam map ACTION --help shows the options.")
    p.add_argument("action", choices=("info", "refine", "evaluate", "merge"))
    p.add_argument("arguments", nargs=argparse.REMAINDER, metavar="...")

    p = commands.add_parser("priors", help="content of prior files")
    p.add_argument("files", nargs="+", metavar="FILE|DIR")

    p = commands.add_parser("settings", help="every setting with its default")
    p.add_argument("--kind", choices=("driving", "indoor"), default="driving")

    p = commands.add_parser("completion", help="a script that completes commands in a shell",
                            description="bash: kys-slam completion bash > "
                            "~/.local/share/bash-completion/completions/kys-slam")
    p.add_argument("shell", choices=("bash", "zsh", "tcsh"))

    p = commands.add_parser("demo", help="test the installation on a small simulated corridor")
    p.add_argument("--frames", type=_whole(1), default=40)
    return parser
