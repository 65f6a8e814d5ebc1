# SPDX-License-Identifier: BSD-3-Clause
"""The networks of --segment-model, --stereo-model and --flow-model: perception outputs of recordings as
jobs of the workflow, made by tools/perception/make_priors.py.
"""
import os

import yaml

from runs import InputError, digest
from inputs import first_line  # runs knows where it is

HERE = os.path.dirname(os.path.abspath(__file__))
SOURCE = os.path.dirname(os.path.dirname(HERE))
PERCEPTION = os.path.join(SOURCE, "tools", "perception")
KINDS = ("segment", "stereo", "flow")
CONFIG = "priors_robust.yaml"  # of build_priors, for perception with errors
# What makes the outputs.
CODE = [os.path.join(PERCEPTION, name) for name in ("make_priors.py", "common.py", "fields_onnx.py",
                                                    "onnx_network.py", "segment_onnx.py")]
CODE.append(os.path.join(SOURCE, "python", "kys_slam", "segment_network.py"))
# Layouts whose images the networks read as they are; EuRoC's are not rectified.
LAYOUTS = ("kitti/",)
WITHOUT = ("no prior files and no perception outputs of it are given: --segment-model MODEL.yaml makes "
           "them as jobs")
OTHER_LAYOUT = ("no prior files and no perception outputs of it are given, and --segment-model reads "
                "KITTI odometry alone (tools/perception/README.md has the steps by hand)")


def add_arguments(parser):
    for kind, what in zip(KINDS, ("segmentation: perception of recordings becomes jobs",
                                  "disparity instead of SGBM", "optical flow instead of DIS")):
        parser.add_argument(f"--{kind}-model", metavar="YAML", help=f"network for {what}")
        parser.add_argument(f"--{kind}-weights", metavar="FILE",
                            help="its ONNX file (default: what its YAML file names)")


def read_settings(path):
    """The content of a network's YAML file. InputError naming it."""
    try:
        with open(path, encoding="utf-8") as file:
            settings = yaml.safe_load(file)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"{path}: {getattr(error, 'strerror', None) or first_line(error)}") from None
    if not isinstance(settings, dict):
        raise InputError(f"{path}: is not a list of settings")
    return settings


class Networks:
    """The networks that are given, and what their outputs depend on beside the images."""

    def __init__(self, options):
        self.arguments = []  # of make_priors.py
        self.state = {"code": [digest(path) for path in CODE]}
        for kind in KINDS:
            model, weights = (getattr(options, f"{kind}_{what}", None) for what in ("model", "weights"))
            if model:
                self._add(kind, os.path.abspath(model), weights and os.path.abspath(weights))
            elif weights:
                raise InputError(f"--{kind}-weights needs --{kind}-model")
        if "segment" not in self.state:
            raise InputError(f"--{next(k for k in KINDS if k in self.state)}-model needs --segment-model")

    def _add(self, kind, model, weights):
        settings = read_settings(model)
        file = weights or os.path.join(os.path.dirname(model), str(settings.get("file", "")))
        if not os.path.isfile(file):
            raise InputError(f"{file}: no such file; the weights of {model} (--{kind}-weights)")
        option = "" if kind == "segment" else f"{kind}-"
        self.arguments += [f"--{option}model", model, f"--{option}weights", file]
        self.state[kind] = [digest(model), digest(file)]
        if kind == "segment":
            self.label_space = self._label_space(model, settings)

    def _label_space(self, model, settings):
        """As the programs take it: a path without endings where its files are beside the YAML file."""
        name = settings.get("label_space")
        if not name:
            raise InputError(f"{model}: label_space is missing")
        beside = os.path.join(os.path.dirname(model), str(name))
        files = [f"{beside}.{kind}.csv" for kind in ("classes", "table")]
        if not os.path.isfile(files[0]):
            return str(name)
        if not os.path.isfile(files[1]):
            raise InputError(f"{files[1]}: no such file")
        self.state["label space"] = [digest(path) for path in files]
        return beside


def given(options):
    """The networks of these options; None without any."""
    asked = any(getattr(options, f"{kind}_{what}", None) for kind in KINDS for what in ("model", "weights"))
    return Networks(options) if asked else None


def reads(name):
    return name.startswith(LAYOUTS)


def builder_arguments(folder, label_space, config):
    """Options of build_priors for the outputs of make_priors.py in a folder."""
    inside = lambda *names: os.path.join(folder, *names)
    has = lambda what: os.path.isdir(inside(what, "left"))
    arguments = ["--panoptic-left", inside("panoptic", "left"), "--panoptic-right", inside("panoptic", "right"),
                 "--label-space", label_space,
                 "--disparity", inside("disparity", "left") if has("disparity") else "sgbm"]
    if has("disparity"):
        arguments += ["--disparity-right", inside("disparity", "right")]
    for side in ("left", "right"):
        arguments += [f"--flow-{side}", inside("flow", side) if has("flow") else "dis"]
        if has("flow"):
            arguments += [f"--flow-back-{side}", inside("flow_back", side)]
    if config == CONFIG:
        arguments += ["--flow", "keypoints"]
    return arguments
