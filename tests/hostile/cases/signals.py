# SPDX-License-Identifier: BSD-3-Clause
"""Signals."""
import os
import signal
import time

from harness import CASES, FRAMES, case, complete, expect, passed, saved


def slow_run(f, programs, *arguments, before=None):
    """A run that waits for its second frame."""
    f.write("seq/times.txt", "".join(f"{10 * i}\n" for i in range(FRAMES)))
    process = programs.start("run_stereo_kitti", [f.sequence, "--output", f.output, "--quiet",
                                                  *arguments], before=before)
    end = time.monotonic() + 20
    while not os.path.isdir(f.output) and time.monotonic() < end:
        time.sleep(0.01)
    time.sleep(2)
    expect(process.poll() is None, "ended by itself")
    return process


def saving_signal(number, *arguments):
    def check(f, programs):
        process = slow_run(f, programs, *arguments)
        begin = time.monotonic()
        process.send_signal(number)
        result = programs.finish(process, 30)
        expect(time.monotonic() - begin < 10, "waited")
        expect(result.status == 0, f"status {result.status}: {result.err}")
        summary = saved(f, 1)
        expect(summary["end_reason"] == "interrupted", summary)
    return check


for signal_name in ("SIGINT", "SIGTERM", "SIGHUP"):
    CASES[f"signals_{signal_name}_while_waiting"] = saving_signal(
        getattr(signal, signal_name), "--schedule", "realtime")
CASES["signals_SIGINT_in_a_stall"] = saving_signal(signal.SIGINT, "--set",
                                                   "control.stall_ms=60000")


@case
def signals_ignored_stay_ignored(f, programs):
    def ignore():
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    process = slow_run(f, programs, "--schedule", "realtime", before=ignore)
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGINT)
    time.sleep(1)
    expect(process.poll() is None, "ended by an ignored signal")
    process.send_signal(signal.SIGTERM)
    passed(programs.finish(process, 30))
    saved(f, 1)


@case
def signals_nobody_reads(f, programs):
    process = programs.start("run_stereo_kitti", [f.sequence, "--output", f.output])
    process.stdout.close()
    process.stdout = None
    passed(programs.finish(process))
    complete(f)


@case
def signals_after_the_last_frame(f, programs):
    """All frames are there; the optimisation that follows them is not."""
    process = slow_run(f, programs, "--frames", "1", "--set", "control.stall_ms=60000")
    process.send_signal(signal.SIGINT)
    passed(programs.finish(process, 30))
    summary = saved(f, 1)
    expect(not summary["complete"] and summary["end_reason"] == "interrupted", summary)
