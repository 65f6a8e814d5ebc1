# SPDX-License-Identifier: BSD-3-Clause
"""Sequences of the known data sets under a folder, wherever in it they are."""
import dataclasses
import hashlib
import os
import re

import yaml

FACTS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "recordings.yaml")
IMAGES = (".png", ".jpg", ".jpeg")
# Folders of left images, by layout.
LEFT = {"kitti": ("image_0", "image_2"), "tracking": (".",), "euroc": (os.path.join("mav0", "cam0", "data"),),
        "vkitti": (os.path.join("frames", "rgb", "Camera_0"),)}
DEPTH = 7  # of folders below the root that are looked into
PERCEPTION = ("panoptic_left", "panoptic_right")


@dataclasses.dataclass
class Sequence:
    """A recording in one of the layouts the run_stereo programs read."""

    name: str  # "kitti/00", "tracking/0001", "euroc/MH01", "vkitti/Scene01"
    folder: str

    @property
    def label_space(self):
        return "vkitti2" if self.name.startswith("vkitti/") else "coco_panoptic_133"

    @property
    def places(self):
        """Its folder, and the files and folders elsewhere that the programs read with it."""
        root, name = os.path.dirname(os.path.dirname(self.folder)), os.path.basename(self.folder)
        beside = {"kitti": [f"poses/{name}.txt"],
                  "tracking": [f"image_03/{name}", f"calib/{name}.txt", f"oxts/{name}.txt"]}
        return [self.folder, *(os.path.join(root, place)
                               for place in beside.get(self.name.partition("/")[0], []))]

    def frames(self):
        """Number of its left images."""
        for place in LEFT[self.name.partition("/")[0]]:
            try:
                with os.scandir(os.path.join(self.folder, place)) as entries:
                    return sum(e.name.lower().endswith(IMAGES) for e in entries)
            except OSError:
                continue
        return 0


def lengths():
    """Frames of whole recordings, by name, where they are known."""
    with open(FACTS, encoding="utf-8") as file:
        return yaml.safe_load(file)["lengths"]


def name_of(folder):
    """The name of the sequence in this very folder, None when it is none."""
    parts = os.path.normpath(folder).split(os.sep)
    name = parts[-1]
    holds = lambda *inside: os.path.isdir(os.path.join(folder, *inside))
    if holds("mav0"):
        match = re.search(r"(MH|V1|V2)_?(\d\d)", name)
        return f"euroc/{match[1]}{match[2]}" if match else None
    if len(parts) > 1 and re.fullmatch(r"Scene\d+", parts[-2]) and name == "clone":
        return f"vkitti/{parts[-2]}" if holds("frames") else None
    if len(parts) > 1 and parts[-2] == "image_02" and re.fullmatch(r"\d{4}", name):
        return f"tracking/{name}"
    if re.fullmatch(r"\d\d", name) and (holds("image_0") or holds("image_2")):
        return f"kitti/{name}"
    return None


def find(root):
    """Sequences by name; of several folders with one name the first in alphabetical order."""
    found = {}

    def look(folder, depth):
        name = name_of(folder)
        if name is not None:
            found.setdefault(name, Sequence(name, folder))
            return
        if depth == 0:
            return
        try:
            inside = sorted(e.path for e in os.scandir(folder) if e.is_dir())
        except OSError:
            return
        for path in inside:
            look(path, depth - 1)

    look(os.path.abspath(root), DEPTH)
    return found


def find_trajectories(root):
    """Files of recorded trajectories by the name of their sequence: poses/05.txt or kitti/05.txt
    (KITTI's format), euroc/V1_02_medium.tum.txt (TUM's)."""
    found = {}
    root = os.path.abspath(root)
    for folder, inside, files in os.walk(root):
        inside.sort()
        if folder[len(root):].count(os.sep) >= DEPTH:
            inside.clear()
        kind = os.path.basename(folder)
        for name in sorted(files):
            if kind in ("poses", "kitti") and re.fullmatch(r"\d\d\.txt", name):
                found.setdefault(f"kitti/{name[:2]}", os.path.join(folder, name))
            match = re.match(r"(MH|V1|V2)_?(\d\d)\w*\.tum\.txt$", name)
            if kind == "euroc" and match:
                found.setdefault(f"euroc/{match[1]}{match[2]}", os.path.join(folder, name))
    return found


def state_of(*places):
    """What tells one state of files and folders from another: number of their files, and a digest of
    these files' names, sizes and times of change."""
    count, state = 0, hashlib.sha256()
    for place in places:
        for file in [place] if os.path.isfile(place) else files_in(place):
            count += 1
            now = os.stat(file)
            state.update(repr((os.path.relpath(file, places[0]), now.st_size, now.st_mtime_ns)).encode(
                "utf-8", "surrogateescape"))
    return [count, state.hexdigest()[:12]]


def files_in(folder):
    """Files at any depth, in a fixed order; none where there is no such folder."""
    for path, inside, files in os.walk(folder):
        inside.sort()
        yield from (os.path.join(path, name) for name in sorted(files))


def prior_files_of(sequence, root):
    """The folder of a sequence's prior files, or None."""
    for folder in (os.path.join(root, "priors", sequence.name), sequence.folder + "-priors"):
        if os.path.isdir(folder) and any(f.endswith(".kysp") for f in os.listdir(folder)):
            return folder
    return None


def perception_of(sequence, root):
    """Where perception outputs of a sequence are: ("perception", folder), ("vkitti", folder of its
    frames), or None."""
    for folder in (os.path.join(root, "perception", sequence.name), sequence.folder):
        if all(os.path.isdir(os.path.join(folder, name)) for name in PERCEPTION):
            return "perception", folder
    frames = os.path.join(sequence.folder, "frames")
    if os.path.isdir(os.path.join(frames, "instanceSegmentation")):
        return "vkitti", frames
    return None
