# SPDX-License-Identifier: BSD-3-Clause
"""Damaged recordings, full disks, signals, options that do not apply: one message, status 2, and
nothing that is computed is lost."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import kys_slam
from bags import write_bag
from kys_slam import cli, cli_run, live
from kys_slam.cli_errors import DEFECT
from test_recordings import OWN, write_video


@pytest.fixture
def folders(tmp_path, corridor):
    """left/, right/ and camera.yaml: 12 frames of the corridor; names are times in ns."""
    cv2 = pytest.importorskip("cv2")
    (tmp_path / "camera.yaml").write_text(OWN)
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for shot in corridor:
            cv2.imwrite(str(tmp_path / side / f"{10**18 + round(shot[2] * 1e9)}.png"),
                        shot[side == "right"])
    return tmp_path


@pytest.fixture
def shots(folders):
    """[(stamp ns, left path, right path)]"""
    return [(int(p.stem), p, folders / "right" / p.name)
            for p in sorted((folders / "left").iterdir())]


def refused(capsys, *arguments):
    """The message of a command that is refused."""
    capsys.readouterr()
    try:
        status = cli.main([str(a) for a in arguments])
    except SystemExit as end:  # of argparse
        status = end.code
    error = capsys.readouterr().err
    assert status == 2, error
    assert error.count("\n") == 1 and "Traceback" not in error, error
    return error


def run_of(folders, *arguments):
    return ("run", folders, "--calibration", folders / "camera.yaml", "--set", "orb.features=600",
            "--quiet", "--output", folders / "run", *arguments)


def summary_of(folder):
    return json.loads((folder / "summary.json").read_text())


def frames_of(folder):
    return len((folder / "frames.csv").read_text().splitlines()) - 1


# Damaged recordings

def test_truncated_video(folders, corridor, capfd):
    """The header counts 12 frames, half of the bytes are there."""
    for side in (0, 1):
        write_video(folders / f"{side}.mkv", [c[side] for c in corridor])
    whole = (folders / "0.mkv").read_bytes()
    (folders / "cut.mkv").write_bytes(whole[:len(whole) // 2])
    camera = ("--calibration", folders / "camera.yaml", "--set", "orb.features=600", "--quiet")
    assert cli.main([str(a) for a in ("run", folders / "0.mkv", folders / "1.mkv", *camera, "--output",
                                      folders / "sound")]) == 0
    assert frames_of(folders / "sound") == len(corridor)
    assert summary_of(folders / "sound")["complete"] is True
    assert cli.main([str(a) for a in ("run", folders / "cut.mkv", folders / "1.mkv", *camera,
                                      "--output", folders / "run")]) == 2
    said = re.search(r"kys-slam: (.*cut\.mkv.*frame (\d+) .*)", capfd.readouterr().err)
    tracked = frames_of(folders / "run")
    assert 0 < tracked < len(corridor) and int(said[2]) == tracked
    summary = summary_of(folders / "run")
    assert summary["complete"] is False and summary["end_reason"] == said[1]


@pytest.mark.parametrize("kind", ("ros1", "ros2", "mcap"))
def test_bag_with_a_damaged_message(folders, shots, kind, monkeypatch, capsys):
    """The 13th of 24 messages has too few bytes."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2
    writer = Writer1 if kind == "ros1" else Writer2
    write, count = writer.write, []

    def damaged(self, connection, stamp, data):
        count.append(1)
        write(self, connection, stamp, bytes(data)[:60] if len(count) == 13 else data)

    monkeypatch.setattr(writer, "write", damaged)
    bag = folders / ("d.bag" if kind == "ros1" else "d")
    write_bag(bag, kind, shots, "mono8")
    error = refused(capsys, "run", bag, *run_of(folders)[2:])
    assert f"{bag}: message 13" in error
    assert frames_of(folders / "run") >= 5
    assert "message 13" in summary_of(folders / "run")["end_reason"]


def test_bag_with_a_damaged_index(folders, shots, capsys):
    """Bytes in the middle of the file are wrong, whatever they belong to."""
    write_bag(folders / "d", "mcap", shots, "mono8")
    file = next((folders / "d").glob("*.mcap"))
    data = bytearray(file.read_bytes())
    data[len(data) // 2:len(data) // 2 + 100_000] = b"\xff" * 100_000
    file.write_bytes(data)
    assert str(folders / "d") in refused(capsys, "run", folders / "d", *run_of(folders)[2:])


def test_defect_while_tracking_saves_the_frames(folders, monkeypatch, capsys):
    feed = kys_slam.System.feed_frame

    def broken(self, frame, *more):
        if frame.index == 7:
            raise TypeError("no such thing")
        return feed(self, frame, *more)

    monkeypatch.setattr(kys_slam.System, "feed_frame", broken)
    assert cli.main([str(a) for a in run_of(folders)]) == DEFECT
    error = capsys.readouterr().err
    assert "defect" in error and error.count("\n") == 1
    assert frames_of(folders / "run") == 7


def test_jump_of_the_time_stamps_in_realtime(monkeypatch):
    """10^10 s from one frame to the next: longer than a thread can wait."""
    class Frame:
        def __init__(self, timestamp):
            self.timestamp = timestamp

    monkeypatch.setattr(live, "LONGEST_PAUSE", 0.05)
    seen = [f.timestamp for f in live.Playback([Frame(t) for t in (0.0, 1e10, 1e10 + 0.01)])]
    assert seen == [0.0, 1e10, 1e10 + 0.01]


def test_stall_comes_on_top_of_the_pace(folders, monkeypatch):
    """As in the C++ programs, on a clock that goes on when somebody waits."""
    class Frame(NamedTuple):
        timestamp: float

    class Clock:
        now = 100.0

        def wait(self, seconds):
            self.now += seconds

        def set(self):
            pass

    def times(**options):
        clock, seen = Clock(), []
        monkeypatch.setattr(live.time, "monotonic", lambda: clock.now)
        playback = live.Playback([Frame(5.0), Frame(5.1), Frame(5.3)], **options)
        playback._stop = clock
        monkeypatch.setattr(playback._queue, "put", lambda frame: seen.append(clock.now - 100))
        playback._play()
        return seen

    assert times() == pytest.approx([0, 0.1, 0.3])
    assert times(stall_ms=50) == pytest.approx([0, 0.15, 0.4])
    assert times(stall_ms=50, speed=2) == pytest.approx([0, 0.1, 0.25])
    monkeypatch.undo()
    given = []
    monkeypatch.setattr(cli_run, "Playback", type("P", (live.Playback,), {
        "__init__": lambda self, *a: given.append(a[4]) or live.Playback.__init__(self, *a)}))
    assert cli.main([str(a) for a in run_of(folders, "--schedule", "realtime", "--frames", 2, "--set",
                                            "control.stall_ms=20")]) == 0
    assert given == [20]


# Output

def test_map_is_checked_before_tracking(folders, capsys):
    file = folders / "none" / "m.map"
    assert str(file) in refused(capsys, *run_of(folders), "--save-map", file)
    assert not (folders / "run" / "frames.csv").exists()


def test_outputs_that_are_the_input(folders, shots, capsys):
    for kind in ("ros1", "mcap"):
        write_bag(folders / ("d.bag" if kind == "ros1" else "d"), kind, shots, "mono8")
    packed = next((folders / "d").glob("*.mcap"))
    shutil.copy(packed, folders / "x.mcap")
    (folders / "link.mcap").symlink_to(folders / "x.mcap")
    for read, *output in (("d.bag", "--save-map", "d.bag"), ("x.mcap", "--record", "x.mcap"),
                          ("x.mcap", "--save-map", "link.mcap"), ("link.mcap", "--record", "x.mcap"),
                          ("d", "--record", packed), ("left.avi", "--save-map", "right.avi")):
        inputs = [folders / read]
        if read == "left.avi":
            inputs.append(folders / "right.avi")
            for file in inputs:
                file.write_bytes(b"not looked at")
        written = folders / output[1]
        before = written.read_bytes()
        said = refused(capsys, "run", *inputs, *run_of(folders)[2:], "--overwrite", output[0], written)
        assert f"{output[0]} {written}: is the input" in said
        assert written.read_bytes() == before and not (folders / "run").exists()
    assert cli.main([str(a) for a in run_of(folders, "--save-map", folders / "new.map")]) == 0


def test_map_is_saved_when_other_results_are_not(folders, capsys):
    (folders / "run" / "frames.csv" / "x").mkdir(parents=True)
    error = refused(capsys, *run_of(folders), "--save-map", folders / "m.map", "--overwrite")
    assert "frames.csv" in error
    assert (folders / "m.map").stat().st_size > 1000
    assert (folders / "run" / "trajectory.tum").exists()


def test_map_of_no_keyframes_is_not_written(folders, capsys):
    """Dark images; the map of another run stays."""
    cv2 = pytest.importorskip("cv2")
    for side in ("left", "right"):
        for path in (folders / side).iterdir():
            cv2.imwrite(str(path), np.zeros((240, 320), np.uint8))
    (folders / "m.map").write_bytes(b"earlier")
    assert cli.main([str(a) for a in run_of(folders, "--no-check", "--save-map", folders / "m.map")]) == 3
    assert f"{folders / 'm.map'}: no map is written" in capsys.readouterr().err
    assert (folders / "m.map").read_bytes() == b"earlier"


def test_map_goes_beside_the_rest(folders, monkeypatch, capsys):
    """The file is checked, then a folder takes its place."""
    finish = kys_slam.System.finish

    def finish_and_block(self):
        finish(self)
        (folders / "m.map" / "x").mkdir(parents=True)

    monkeypatch.setattr(kys_slam.System, "finish", finish_and_block)
    error = refused(capsys, *run_of(folders), "--save-map", folders / "m.map")
    assert "the map is in" in error
    assert (folders / "run" / "saved.map").stat().st_size > 1000


@pytest.mark.parametrize("number", (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
def test_signals_save_what_there_is(folders, number):
    """While the program waits for the second frame."""
    for side in ("left", "right"):
        for i, path in enumerate(sorted((folders / side).iterdir())):
            path.rename(path.with_name(f"{i:03d}.png"))
    (folders / "times.txt").write_text("".join(f"{i * 10}\n" for i in range(12)))
    command = [sys.executable, "-m", "kys_slam",
               *run_of(folders, "--schedule", "realtime", "--times", folders / "times.txt")]

    def start(**more):
        process = subprocess.Popen([str(c) for c in command], stderr=subprocess.PIPE, text=True, **more)
        end = time.monotonic() + 60
        while not (folders / "run").is_dir() and time.monotonic() < end:
            time.sleep(0.05)
        time.sleep(3)
        assert process.poll() is None
        return process

    process = start(preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))
    process.send_signal(number)
    assert process.communicate(timeout=60)[1] == "" and process.returncode == 0
    assert summary_of(folders / "run")["end_reason"] == "interrupted"
    assert frames_of(folders / "run") == 1
    if number == signal.SIGHUP:  # nohup
        command.append("--overwrite")
        process = start(preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
        process.send_signal(number)
        time.sleep(1)
        assert process.poll() is None
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0


def run_with_signals(folders, function, numbers, *more, late=False):
    """A run in a process that gets signals when it calls a function: before, or within (`late`: a second
    later, when it takes longer)."""
    send = f"[os.kill(os.getpid(), n) for n in {[int(n) for n in numbers]}]"
    send = f"threading.Timer(1, lambda: {send}).start()" if late else f"{send}; heard.wait(20)"
    code = f"""if True:
        import os, signal, sys, threading
        import kys_slam.cli_feed
        from kys_slam import cli
        signal.signal(signal.SIGINT, signal.default_int_handler)
        heard, interrupt, call = threading.Event(), kys_slam.System.interrupt, kys_slam.{function}
        kys_slam.System.interrupt = lambda self: (interrupt(self), heard.set())
        def signalled(*given, **named):
            {send}
            return call(*given, **named)
        kys_slam.{function} = signalled
        sys.exit(cli.main(sys.argv[1:]))
    """
    return subprocess.run([sys.executable, "-c", code, *map(str, run_of(folders, *more))],
                          stderr=subprocess.PIPE, text=True, timeout=50, check=False)


@pytest.mark.parametrize("number", (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
@pytest.mark.parametrize("method", ("finish", "write_run", "_save_map_or_beside", "snapshot"))
def test_signals_after_the_last_frame(folders, method, number):
    """While optimisation ends, and while results, map and recordings are written."""
    more = ["--save-map", folders / "m.map"]
    if method == "snapshot":  # of a recorder's end
        reader = pytest.importorskip("mcap.reader")
        pytest.importorskip("mcap_protobuf")
        more += ["--record", folders / "r.mcap"]
    done = run_with_signals(folders, f"System.{method}", [number], *more)
    assert (done.returncode, done.stderr) == (0, "")
    summary = summary_of(folders / "run")
    assert summary["complete"] is (method != "finish")
    assert summary.get("end_reason") == ("interrupted" if method == "finish" else None)
    assert frames_of(folders / "run") == 12 and (folders / "m.map").stat().st_size > 1000
    if method == "snapshot":
        with open(folders / "r.mcap", "rb") as stream:
            assert "/map" in {channel.topic for _, channel, _ in
                              reader.make_reader(stream).iter_messages()}


def test_signal_in_a_call_of_the_library(folders):
    """Each frame would sleep for a minute."""
    done = run_with_signals(folders, "System.feed_frame", [signal.SIGINT], "--set", "control.stall_ms=60000",
                            late=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert summary_of(folders / "run")["end_reason"] == "interrupted"
    assert frames_of(folders / "run") == 1


def test_second_signal_ends_the_program(folders):
    done = run_with_signals(folders, "System.finish", [signal.SIGTERM, signal.SIGTERM])
    assert done.returncode == -signal.SIGTERM


def test_signal_before_the_first_frame(folders):
    """There is nothing to save, and earlier results stay."""
    assert cli.main([str(a) for a in run_of(folders)]) == 0
    before = (folders / "run" / "summary.json").read_bytes()
    done = run_with_signals(folders, "cli_feed.Feed.all", [signal.SIGTERM], "--overwrite")
    assert (done.returncode, done.stderr) == (130, "kys-slam: interrupted\n")
    assert (folders / "run" / "summary.json").read_bytes() == before


def test_one_recording_that_fails(folders, capsys):
    """A full disk under the first; the second is complete."""
    pytest.importorskip("mcap_protobuf")
    reader = pytest.importorskip("mcap.reader")
    full, good = folders / "full.mcap", folders / "good.mcap"
    full.symlink_to("/dev/full")
    error = refused(capsys, *run_of(folders), "--overwrite", "--record", full, "--record", good)
    assert str(full) in error and str(good) not in error
    with open(good, "rb") as stream:
        topics = {channel.topic for _, channel, _ in reader.make_reader(stream).iter_messages()}
    assert {"/frame", "/pose/final", "/map"} <= topics
    assert frames_of(folders / "run") == 12
    other = folders / "right" / ".." / "good.mcap"
    assert "twice" in refused(capsys, *run_of(folders), "--overwrite", "--record", good, "--record",
                              other)


def test_refused_first_pair_leaves_no_recording(folders, capsys):
    pytest.importorskip("mcap_protobuf")
    file = folders / "run.mcap"
    swapped = ("run", folders / "right", folders / "left", *run_of(folders)[2:], "--record", file)
    assert "swapped" in refused(capsys, *swapped)
    assert not file.exists()
    assert "swapped" in refused(capsys, *swapped)


def test_the_reader_of_the_output_may_have_gone():
    code = ("import os, sys; from kys_slam import cli; cli._function_of = lambda c: lambda a: print('x') or 0; "
            "r, w = os.pipe(); os.close(r); os.dup2(w, 1); sys.exit(cli.main(['demo']))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False,
                          env={**os.environ, "PYTHONUNBUFFERED": ""})
    assert (done.returncode, done.stderr) == (0, "")


# Options

def test_mode_that_is_named_stays(folders, corridor, capsys):
    """Priors choose a mode only where none is named."""
    cv2 = pytest.importorskip("cv2")
    (folders / "masks" / "left").mkdir(parents=True)
    (folders / "masks" / "right").mkdir()
    (folders / "masks" / "classes.txt").write_text("1 car moving\n")
    for side in ("left", "right"):
        for path in (folders / side).iterdir():
            cv2.imwrite(str(folders / "masks" / side / path.name), np.ones((240, 320), np.uint8))
    (folders / "stock.yaml").write_text("kys: {mode: stock}\n")
    modes = []
    for more in ((), ("--set", "kys.mode=stock"), ("--config", folders / "stock.yaml"),
                 ("--mode", "kys", "--set", "kys.mode=stock")):
        assert cli.main([str(a) for a in run_of(folders, "--overwrite", "--frames", 2, "--masks",
                                                folders / "masks", *more)]) in (0, 3)
        modes.append(summary_of(folders / "run")["mode"])
    assert modes == ["verified", "stock", "stock", "kys"]


def test_masks_that_fit_no_frame_are_told_once(folders, capsys):
    cv2 = pytest.importorskip("cv2")
    (folders / "masks").mkdir()
    cv2.imwrite(str(folders / "masks" / "other.png"), np.zeros((240, 320), np.uint8))
    assert cli.main([str(a) for a in run_of(folders, "--frames", 3, "--masks", folders / "masks")]) == 0
    error = capsys.readouterr().err
    first = sorted(path.stem for path in (folders / "left").iterdir())[0]
    assert error.count(f"no mask for frame {first}") == 1 and error.count("no mask") == 1, error
    summary = summary_of(folders / "run")
    assert any("no mask for frame" in warning for warning in summary["warnings"]), summary


def test_tolerance_of_a_folder_with_both_sides(folders):
    """Right images 5 ms late: no pairs with the default of 3 ms, all with 6 ms."""
    for path in sorted((folders / "right").iterdir()):
        path.rename(path.with_name(f"{int(path.stem) + 5_000_000}.png"))
    assert cli.main([str(a) for a in run_of(folders, "--tolerance", 0.006)]) == 0
    assert frames_of(folders / "run") == 12


def test_options_of_other_inputs(folders, shots, corridor, capsys):
    sequence = folders / "kitti"
    for side in ("image_0", "image_1"):
        (sequence / side).mkdir(parents=True)
    for i, (_, left, right) in enumerate(shots):
        (sequence / "image_0" / f"{i:06d}.png").symlink_to(left)
        (sequence / "image_1" / f"{i:06d}.png").symlink_to(right)
    (sequence / "times.txt").write_text("".join(f"{i / 10}\n" for i in range(12)))
    (sequence / "calib.txt").write_text(
        "P0: 250 0 159.5 0 0 250 119.5 0 0 0 1 0\nP1: 250 0 159.5 -50 0 250 119.5 0 0 0 1 0\n")
    camera = ("--calibration", folders / "camera.yaml")
    write_video(folders / "both.avi", [np.hstack(c[:2]) for c in corridor])
    for option in (("--rate", 3), ("--times", "nofile"), ("--topics", "a", "b"), camera,
                   ("--calibration-unit", 5), ("--tolerance", 0.01), ("--queue", 7)):
        assert option[0] in refused(capsys, "run", sequence, *option, "--output", folders / "o")
    for option in (("--times", "nofile"), ("--pair", "grey"), ("--tolerance", 0.01)):
        assert option[0] in refused(capsys, "run", folders / "both.avi", *camera, *option)
    for option in (("--pair", "grey"), ("--topics", "a", "b")):
        assert option[0] in refused(capsys, *run_of(folders, *option))
    for option in ("--rate", "--tolerance", "--speed", "--queue", "--frames", "--start",
                   "--calibration-unit"):
        for value in ("nan", "-1", "1e400", "99999999999999999999", "x", "²"):
            assert option in refused(capsys, *run_of(folders, option, value))
    assert "--rate" in refused(capsys, "run", folders / "both.avi", *camera, "--rate", 0)
    for size in ("99999999999x5", "0x5", "5", "x", "5x5x5"):
        assert "--size" in refused(capsys, "calibrate", folders / "camera.yaml", "--size", size)


def indices_of(folder):
    return [int(line.split(",")[0]) for line in (folder / "frames.csv").read_text().splitlines()[1:]]


@pytest.mark.parametrize("kind", ("folders", "video", "bag"))
def test_frames_have_the_numbers_of_the_recording(folders, shots, corridor, kind, monkeypatch):
    """From the third frame on, and with one left out: in the results and where pairs are checked."""
    if kind == "video":
        write_video(folders / "both.avi", [np.hstack(c[:2]) for c in corridor])
    if kind == "bag":
        write_bag(folders / "d.bag", "ros1", shots, "mono8")
    file = {"folders": folders, "video": folders / "both.avi", "bag": folders / "d.bag"}[kind]
    checked = []

    class Watch:
        warning = ""

        def count_frame(self):
            return True

        def check(self, left, right, index):
            checked.append(index)

        def finish(self):
            pass

    class LateOnce(live.Playback):
        def __iter__(self):
            return (frame for i, frame in enumerate(self._recording) if i != 4)

    monkeypatch.setattr(kys_slam, "PairHistory", Watch)
    for schedule, playback, numbers in (("sequential", live.Playback, [3, 4, 5, 6, 7, 8, 9, 10, 11]),
                                        ("realtime", LateOnce, [3, 4, 5, 6, 8, 9, 10, 11])):
        monkeypatch.setattr(cli_run, "Playback", playback)
        checked.clear()
        assert cli.main([str(a) for a in ("run", file, *run_of(folders)[2:], "--overwrite", "--start", 3,
                                          "--schedule", schedule)]) == 0
        assert indices_of(folders / "run") == checked == numbers


def test_start_behind_the_end(folders, shots, corridor, capsys):
    write_video(folders / "both.avi", [np.hstack(c[:2]) for c in corridor])
    write_bag(folders / "d.bag", "ros1", shots, "mono8")
    for file in ("both.avi", "d.bag"):
        said = refused(capsys, "run", folders / file, *run_of(folders)[2:], "--start", 12)
        assert "holds no stereo pair at 12 (start)" in said


def test_results_name_their_recording(folders):
    """As those of the C++ programs, which do not overwrite results of another recording."""
    assert cli.main([str(a) for a in run_of(folders, "--start", 2, "--frames", 3)]) == 0
    named = summary_of(folders / "run")["recording"]
    assert re.fullmatch(r"frame 2: [0-9a-f]{16}", named)
    rig = kys_slam.read_stereo_rig([folders / "camera.yaml"])
    others = [kys_slam.open_image_pair(folders / "left", folders / "right", rig, start=start).recording
              for start in (2, 3)]
    assert others[0] == named and others[1].startswith("frame 3: ")
    assert others[1].split()[-1] != named.split()[-1]


def test_options_that_need_others(folders, capsys):
    """None is ignored without a word."""
    assert "needs --priors" in refused(capsys, *run_of(folders, "--strict-priors"))
    (folders / "times.txt").write_text("".join(f"{i}\n" for i in range(12)))
    times = ("--times", folders / "times.txt")
    assert "exclude each other" in refused(capsys, *run_of(folders, "--rate", 10, *times))
    for more in (("--rate", 10), times):
        error = refused(capsys, *run_of(folders, "--tolerance", 0.01, *more))
        assert "--tolerance does not apply" in error and "neither --rate nor --times" in error
    for side in ("left", "right"):
        for i, path in enumerate(sorted((folders / side).iterdir())):
            path.rename(path.with_name(f"{i:03d}.png"))
    assert "--tolerance does not apply" in refused(capsys, *run_of(folders, "--tolerance", 0.01))
    assert not (folders / "run").exists()


def test_missing_prior_file_is_one_line(folders, corridor_camera, capsys, caplog):
    from test_priors import example
    (folders / "priors").mkdir()
    names = sorted(path.stem for path in (folders / "left").iterdir())
    for name in names[:2]:
        kys_slam.write_prior(folders / "priors" / f"{name}.kysp", example(corridor_camera))
    said = (f"{folders / 'priors' / names[2]}.kysp: no prior file for this frame; it has no priors "
            "(reported once)")
    assert cli.main([str(a) for a in run_of(folders, "--frames", 4, "--priors", folders / "priors")]) == 0
    assert capsys.readouterr().err == f"kys-slam: warning: {said}\n"
    assert summary_of(folders / "run")["missing_priors"] == 2
    slam = kys_slam.System(corridor_camera, {"kys.mode": "kys"}, priors=folders / "priors")
    for frame in kys_slam.open_image_pair(folders / "left", folders / "right",
                                          kys_slam.read_stereo_rig([folders / "camera.yaml"]), frames=4):
        slam.feed_frame(frame)
    assert [(r.name, r.levelname, r.getMessage()) for r in caplog.records] == [
        ("kys_slam", "WARNING", said)]


def test_classes_with_digits_of_another_kind(folders, capsys):
    (folders / "masks").mkdir()
    (folders / "masks" / "0.png").touch()
    (folders / "masks" / "classes.txt").write_text("² car\n")
    assert "classes.txt:1" in refused(capsys, *run_of(folders, "--masks", folders / "masks"))


# Results of runs that are lost or damaged

@pytest.fixture(scope="module")
def tracked(corridor, corridor_camera, tmp_path_factory):
    """Folder of a run with ground truth that goes on after its end."""
    slam = kys_slam.System(corridor_camera, {"orb.features": 600})
    for left, right, timestamp, _ in corridor:
        slam.feed(left, right, timestamp)
    slam.finish()
    n = 2 * len(corridor)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, 3] = [(0.3 * np.sin(0.05 * i), 0, 0.1 * i) for i in range(n)]  # as kys_slam.demo has it
    folder = tmp_path_factory.mktemp("tracked") / "run"
    folder.mkdir()
    slam.write_run(folder, "corridor", (0.1 * np.arange(n), poses))
    return folder


@pytest.fixture
def damaged(tracked, tmp_path):
    """A copy whose files the test changes."""
    pytest.importorskip("matplotlib")
    pytest.importorskip("evo")
    return Path(shutil.copytree(tracked, tmp_path / "run"))


def test_lost_run_is_drawn_and_said(damaged, tracked, capsys):
    (damaged / "trajectory.tum").write_text("")
    lost = damaged.rename(damaged.with_name("gone"))
    for runs in ([lost], [lost, tracked]):
        for command, file in (("plot", "p.png"), ("report", "p.html")):
            assert cli.main([command, *map(str, runs), "--output", str(lost / file)]) == 0
            assert (lost / file).stat().st_size > 5000
    from kys_slam.plot import load_run
    assert load_run(lost, None).label == "gone: lost"
    assert "no times in common" in refused(capsys, "evaluate", lost)


def test_summaries_that_are_none(damaged, capsys):
    summary = json.loads((damaged / "summary.json").read_text())
    wrong = [[], None, 5, {"left_out": [1]}, {"path_length_m": "x"}, {"frames": "<script>x</script>"},
             {"mode": {}}, {"complete": "no"}, {"end_reason": []}, {"loops_closed": "1"}]
    for what in [json.dumps(w if not isinstance(w, dict) else {**summary, **w}) for w in wrong] + [
            "[" * 100000, "", "{", "\xff"]:
        (damaged / "summary.json").write_text(what, encoding="latin-1")
        assert "summary.json" in refused(capsys, "report", damaged, "--output", damaged / "p.html")
    assert not (damaged / "p.html").exists()


def test_every_cell_of_the_page_is_escaped(damaged):
    summary = json.loads((damaged / "summary.json").read_text())
    bad = "<script>x</script>"
    summary.update(mode=bad, complete=False, end_reason=bad, left_out={bad: bad})
    (damaged / "summary.json").write_text(json.dumps(summary))
    folder = damaged.rename(damaged.with_name("<script>x<"))
    assert cli.main(["report", str(folder), "--output", str(folder / "p.html")]) == 0
    assert "<script" not in (folder / "p.html").read_text()


def test_frames_without_rows(damaged):
    header = (damaged / "frames.csv").read_text().splitlines()[0]
    (damaged / "frames.csv").write_text(header + "\n")
    assert cli.main(["report", str(damaged), "--output", str(damaged / "p.html")]) == 0
    assert "nan" not in (damaged / "p.html").read_text().split("<h2>")[0]


@pytest.mark.parametrize("name", (b"caf\xe9", b"a$b$c_{x", "\u00fc x".encode()))
def test_names_of_folders(damaged, name, capsys):
    folder = damaged.rename(damaged.with_name(os.fsdecode(name)))
    for command, file in (("plot", "p.png"), ("report", "p.html")):
        assert cli.main([command, str(folder), "--output", str(folder / file)]) == 0
        assert (folder / file).stat().st_size > 5000


def test_report_draws_ground_truth_where_it_belongs(tracked, monkeypatch):
    """Truth at 2.5 times the frames' rate, longer than the run, in a frame turned by 90 degrees: what
    is drawn is the pose at the time of each frame, not the next one."""
    pytest.importorskip("matplotlib")
    pytest.importorskip("evo")
    from kys_slam import report
    times, poses = kys_slam.read_tum(tracked / "trajectory.tum")
    run = Path(shutil.copytree(tracked, tracked.with_name("turned")))
    turn = np.array([[0, 0, 1, 5], [0, 1, 0, 0], [-1, 0, 0, 7], [0, 0, 0, 1.0]])
    many = np.sort(np.concatenate([times, times + 0.004, times[-1] + np.arange(1, 9)]))
    truth = np.tile(np.eye(4), (len(many), 1, 1))
    for axis in range(3):
        truth[:, axis, 3] = np.interp(many, times, poses[:, axis, 3])
    truth[np.isin(many, times + 0.004), 1, 3] += 1  # poses of other moments
    kys_slam.write_tum(run / "ground_truth.tum", many, turn @ truth)
    drawn = []
    draw_paths = report.draw_paths
    monkeypatch.setattr(report, "draw_paths", lambda runs, axes: (drawn.extend(runs),
                                                                  draw_paths(runs, axes))[1])
    report.write_report([run], run / "p.html")
    at = np.isin(many, times)
    difference = drawn[0].truth.poses[at][:len(times), :3, 3] - drawn[0].path.poses[:, :3, 3]
    assert np.abs(difference).max() < 1e-6
