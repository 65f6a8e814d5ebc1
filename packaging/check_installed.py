# SPDX-License-Identifier: BSD-3-Clause
"""Tracks with what is installed: the demonstration, and recordings on disk that it draws itself.

    python3 check_installed.py FOLDER [RECORDING...]

Uses the package kys_slam and NumPy only. Two recordings are written to FOLDER (PNG as grey and as palette),
with settings as YAML, so that the libraries that read files are called; more may be given. Prints the
SHA-256 of each trajectory: it is the same wherever the package is installed.
"""

import argparse
import hashlib
import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np

import kys_slam
from kys_slam import demo, drawing

FRAMES = 12


def grey_png(pixels: np.ndarray) -> bytes:
    """PNG of (H, W) uint8."""
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width = pixels.shape
    rows = np.zeros((height, width + 1), np.uint8)  # each begins with filter 0
    rows[:, 1:] = pixels
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows.tobytes())) + chunk(b"IEND", b""))


def palette_png(pixels: np.ndarray) -> bytes:
    """The same picture, as indices of 256 greys."""
    greys = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 4, axis=1)
    greys[:, 3] = 255
    return drawing.encode_png(pixels, greys)


def write_kitti(folder: Path, encode) -> None:
    """The demonstration as a KITTI odometry sequence."""
    c = demo.CAMERA
    times = []
    for i in range(FRAMES):
        left, right, time, _ = demo.stereo_frame(i)
        for side, picture in enumerate((left, right)):
            path = folder / f"image_{side}" / f"{i:06d}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(encode(picture))
        times.append(f"{time:.6e}\n")
    rows = []
    for camera in range(4):
        shift = -c["fx"] * c["baseline"] * (camera % 2)
        values = [c["fx"], 0, c["cx"], shift, 0, c["fy"], c["cy"], 0, 0, 0, 1, 0]
        rows.append(f"P{camera}: " + " ".join(f"{v:.12e}" for v in values) + "\n")
    (folder / "calib.txt").write_text("".join(rows), encoding="ascii")
    (folder / "times.txt").write_text("".join(times), encoding="ascii")


def track(recording: Path, output: Path, *options: str) -> str:
    """Runs the command; returns the SHA-256 of its trajectory."""
    call = [sys.executable, "-m", "kys_slam", "run", str(recording), "--output", str(output), "--overwrite",
            "--quiet", *options]
    status = subprocess.run(call, check=False).returncode
    if status != 0:
        raise SystemExit(f"{' '.join(call)}: exit status {status}")
    return hashlib.sha256((output / "trajectory.tum").read_bytes()).hexdigest()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("recordings", nargs="*", type=Path, metavar="RECORDING")
    args = parser.parse_args()
    folder = args.folder
    folder.mkdir(parents=True, exist_ok=True)
    if demo.run_demo(20) != 0:
        return 3
    settings = folder / "settings.yaml"
    settings.write_text("orb:\n  features: 600\n", encoding="ascii")
    digests = {}
    for name, encode in (("grey", grey_png), ("palette", palette_png)):
        write_kitti(folder / name, encode)
        digests[name] = track(folder / name, folder / f"run-{name}", "--config", str(settings))
    if digests["grey"] != digests["palette"]:
        raise SystemExit("the same pictures in two kinds of PNG give different trajectories")
    for recording in args.recordings:
        digests[recording.name] = track(recording, folder / f"run-{recording.name}")
    for name, digest in digests.items():
        print(f"trajectory {digest} {name}")
    print(f"kys_slam {kys_slam.__version__} of {os.path.dirname(kys_slam.__file__)}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
