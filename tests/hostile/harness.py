# SPDX-License-Identifier: BSD-3-Clause
"""What the cases share: a small sequence, the programs, what is expected of them."""
import json
import os
import resource
import shutil
import signal
import struct
import subprocess
import zlib

WIDTH, HEIGHT, FRAMES, DISPARITY = 320, 120, 12, 16
FX, BF = 200.0, 100.0
OUTPUTS = ("trajectory.tum", "trajectory.kitti", "keyframes.tum", "frames.csv", "covariance.csv",
           "graph.csv", "config.yaml", "map.ply", "summary.json")


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


def as_nobody(more=lambda: None):
    """Without the rights of the administrator, who may read everything."""
    def before():
        more()
        if os.getuid() == 0:
            os.setgid(65534)
            os.setuid(65534)
    return before
