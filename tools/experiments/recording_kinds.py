# SPDX-License-Identifier: BSD-3-Clause
"""Kinds of real recordings: how their folders are recognised, what a run of them reads, the command
that runs them, and the digest of their input."""
import dataclasses
import hashlib
import os
import re
import shutil
import sys

import raw_drive
from data_sets import DEPTH, name_of
from runs import InputError, digest, find_program, remove

DIGITS = 12  # of digests that are shown
IMAGES = (".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".bmp", ".tif", ".tiff")


@dataclasses.dataclass
class Recording:
    """`name`: what recordings.yaml knows it by; `images`: folders of the left and the right images;
    `files`: calibration and time stamps; `row`: its name in the table, which no other one has."""

    name: str
    kind: str
    folder: str
    images: list
    files: list
    row: str = ""

    def image_files(self, limit=None):
        """Paths in the order of their names, left before right; `limit`: of each at most. A folder that is
        missing has none."""
        for folder in filter(os.path.isdir, self.images):
            names = sorted(f for f in os.listdir(folder) if f.lower().endswith(IMAGES))
            yield from (os.path.join(folder, name) for name in names[:limit])

    def frames_here(self):
        return sum(1 for path in self.image_files() if os.path.dirname(path) == self.images[0])

    def digest(self, limit=None):
        """Of names, and of the content of calibration, time stamps and images. Files that are missing do
        not count: the run says what it misses."""
        value = hashlib.sha256()
        files = [f for f in self.files if os.path.isfile(f)]
        for side, path in [*(("file", f) for f in files),
                           *((str(self.images.index(os.path.dirname(f))), f)
                             for f in self.image_files(limit))]:
            value.update(f"{side} {os.path.basename(path)} {digest(path)}\n".encode(
                "utf-8", "surrogateescape"))
        return value.hexdigest()[:DIGITS]


# --- layouts: (kind, folder) -> images and files, None for another layout ------------------------


def _below(folder, *names):
    return [os.path.join(folder, *name.split("/")) for name in names]


def _holds(folder, *names):
    return all(os.path.isdir(path) for path in _below(folder, *names))


def _kitti_odometry(folder):
    left = next((c for c in (0, 2) if _holds(folder, f"image_{c}")), None)
    if left is None:
        return None
    return (_below(folder, f"image_{left}", f"image_{left + 1}"),
            _below(folder, "calib.txt", "times.txt"))


def _kitti_raw(folder):
    left = next((c for c in (0, 2) if _holds(folder, f"image_0{c}/data")), None)
    if left is None:
        return None
    return (_below(folder, f"image_0{left}/data", f"image_0{left + 1}/data"),
            [*_below(os.path.dirname(folder), raw_drive.CALIBRATION),
             *_below(folder, f"image_0{left}/timestamps.txt")])


def _kitti_tracking(folder):
    root, name = os.path.dirname(os.path.dirname(folder)), os.path.basename(folder)
    if os.path.basename(os.path.dirname(folder)) != "image_02" or not re.fullmatch(r"\d{4}", name):
        return None
    return [folder, os.path.join(root, "image_03", name)], _below(root, f"calib/{name}.txt")


def _euroc(folder):
    if not _holds(folder, "mav0"):
        return None
    cameras = _below(folder, "mav0/cam0", "mav0/cam1")
    return ([os.path.join(c, "data") for c in cameras],
            [os.path.join(c, f) for c in cameras for f in ("data.csv", "sensor.yaml")]
            + _below(folder, "camchain.yaml", "dso/camchain.yaml"))


def _virtual_kitti(folder):
    if not _holds(folder, "frames/rgb"):
        return None
    return (_below(folder, "frames/rgb/Camera_0", "frames/rgb/Camera_1"),
            _below(folder, "intrinsic.txt", "extrinsic.txt"))


def _pair_of_folders(folder):
    if not os.path.isfile(os.path.join(folder, "camchain.yaml")) or not _holds(folder, "left", "right"):
        return None
    return _below(folder, "left", "right"), _below(folder, "camchain.yaml", "times.txt")


LAYOUTS = {"KITTI odometry": _kitti_odometry, "KITTI raw": _kitti_raw, "KITTI Tracking": _kitti_tracking,
           "EuRoC or TUM-VI": _euroc, "Virtual KITTI 2": _virtual_kitti, "pair": _pair_of_folders}


def _name(folder, kind):
    name = name_of(folder)
    if kind == "KITTI raw":
        name = "raw/" + re.sub(r"_(sync|extract)$", "", os.path.basename(folder))
    if kind == "Virtual KITTI 2" and name is None:
        name = "vkitti/" + "/".join(folder.split(os.sep)[-2:])
    return name or os.path.basename(folder)


def find(root):
    """Recordings below a folder, in alphabetical order of their paths. A name that is there already is
    followed by the path in the table."""
    root, found = os.path.abspath(root), {}
    if not os.path.isdir(root):
        raise InputError(f"{root}: no such folder")

    def look(folder, depth):
        for kind, layout in LAYOUTS.items():
            parts = layout(folder)
            if parts is not None:
                name = _name(folder, kind)
                row = f"{name} ({os.path.relpath(folder, root)})" if name in found else name
                found[row] = Recording(name, kind, folder, *parts, row)
                return
        if depth > 0:
            try:
                inside = sorted(e.path for e in os.scandir(folder) if e.is_dir())
            except OSError:
                return
            for path in inside:
                look(path, depth - 1)

    look(root, DEPTH)
    return list(found.values())


# --- commands ------------------------------------------------------------------------------------


def python_command(programs):
    """(command, environment) of kys-slam: of the build folder of the programs, or the installed one."""
    package = os.path.join(os.path.dirname(os.path.abspath(programs)), "python")
    if os.path.isdir(os.path.join(package, "kys_slam")):
        return [sys.executable, "-m", "kys_slam"], {**os.environ, "PYTHONPATH": package}
    installed = shutil.which("kys-slam")
    if installed is None:
        raise InputError(f"{package}/kys_slam: no such folder, and no kys-slam is installed")
    return [installed], None


def command(recording, programs, schedule, output, rate=None, limit=None):
    """(command, environment) of a run into a new folder."""
    environment = None
    if recording.kind == "pair":
        start, environment = python_command(programs)
        start += ["run", *recording.images, "--calibration", recording.files[0]]
        if os.path.isfile(recording.files[1]):
            start += ["--times", recording.files[1]]
        elif rate is not None:
            start += ["--rate", str(rate)]
    elif recording.kind == "EuRoC or TUM-VI":
        start = [find_program(programs, "run_stereo_euroc"), recording.folder]
    else:
        folder = recording.folder
        if recording.kind == "KITTI raw":
            folder = output + "-input"
            remove(folder)
            raw_drive.arrange(recording.folder, recording.images, folder)
        start = [find_program(programs, "run_stereo_kitti"), folder]
    remove(output)
    start += ["--schedule", schedule, "--quiet", "--output", output]
    return start + (["--frames", str(limit)] if limit else []), environment
