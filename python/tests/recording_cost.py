# SPDX-License-Identifier: BSD-3-Clause
"""What recording costs, on one sequence.

    python recording_cost.py SEQUENCE [--priors DIR] [--frames 50] [--rounds 8] [--kinds rrd mcap]
    python recording_cost.py SEQUENCE --whole [--schedules sequential pipelined] ...

Without --whole: the thread that feeds, every frame with and without. Of two runs one records the even
frames, the other one the odd ones; each frame is compared with itself, so what differs from run to
run falls out. Prints how much a recorded frame adds to the processor time of the feeding thread and
to the time by the clock: mean over rounds and its standard error. The process that draws works on
half of the frames then: by the clock a whole recording costs more where it shares the processor.

With --whole --apart: the system on one core and what records on another: what recording costs where
a core is free.

With --whole: whole runs in turn with and without, from the first frame to the end of close(); the
recorder's start is told apart. Prints the median over rounds of the ratio by the clock with its 95 %
interval (bootstrap), and processor time per frame: of this process (JPEGs) beyond that without, and
of the process that draws, after its start.
"""

import argparse
import os
import tempfile
import time
from pathlib import Path
from typing import Dict, Tuple

import numpy as np

import kys_slam
from kys_slam.record import open_recorder

WARM_UP = 2  # frames


def new_system(sequence: kys_slam.Sequence, args, schedule: str) -> kys_slam.System:
    settings = kys_slam.Settings({"kys.mode": args.mode or ("kys" if args.priors else "stock")})
    return kys_slam.System(sequence.camera, settings, schedule, args.priors)


def feed_every_other(sequence: kys_slam.Sequence, frames: list, args, kind: str,
                     odd: int) -> np.ndarray:
    """(N, 2) processor time of this thread and wall time of feeding each frame, s."""
    times = []
    with tempfile.TemporaryDirectory() as folder:
        slam = new_system(sequence, args, args.schedules[0])
        recorder = open_recorder(f"{folder}/run.{kind}", slam)
        slam._remove_pipe(recorder._pipe)
        for i, frame in enumerate(frames):
            if i % 2 == odd:
                slam._add_pipe(recorder._pipe)
            c, w = time.thread_time(), time.perf_counter()
            slam.feed_frame(frame)
            times.append((time.thread_time() - c, time.perf_counter() - w))
            if i % 2 == odd:
                slam._remove_pipe(recorder._pipe)
        slam.finish()
        recorder.close()
    return np.array(times)


def one_round(sequence: kys_slam.Sequence, frames: list, args, kind: str,
              first: int) -> Tuple[np.ndarray, np.ndarray]:
    """Mean times per frame (processor, clock), s, with and without."""
    runs = {odd: feed_every_other(sequence, frames, args, kind, odd) for odd in (first, 1 - first)}
    odd_frame = (np.arange(len(frames)) % 2 == 1)[:, None]
    on = np.where(odd_frame, runs[1], runs[0])
    off = np.where(odd_frame, runs[0], runs[1])
    return on[WARM_UP:].mean(0), off[WARM_UP:].mean(0)


def compare_frames(sequence: kys_slam.Sequence, frames: list, args) -> None:
    for kind in args.kinds:
        rounds = [one_round(sequence, frames, args, kind, k % 2) for k in range(args.rounds)]
        ratio = np.array([100 * (on / off - 1) for on, off in rounds])
        mean = ratio.mean(0)
        error = (ratio.std(0, ddof=1) / np.sqrt(len(ratio)) if len(ratio) > 1
                 else np.full(2, np.nan))
        cpu = 1000 * np.mean([off[0] for _, off in rounds])
        print(f"{kind:<5} {mean[0]:+.1f} +- {error[0]:.1f} % of {cpu:.2f} ms of the feeding thread, "
              f"{mean[1]:+.1f} +- {error[1]:.1f} % by the clock")


def pin(process: int, core: int) -> None:
    """All threads of a process, and those they will start."""
    for thread in os.listdir(f"/proc/{process}/task"):
        os.sched_setaffinity(int(thread), {core})


def whole_run(sequence: kys_slam.Sequence, frames: list, args, schedule: str,
              kind: str) -> Dict[str, float]:
    """s: by the clock from the first frame to the end of close(), of which feeding and close();
    start of the recorder; processor time of this process and of drawing."""
    with tempfile.TemporaryDirectory() as folder:
        if args.apart:
            pin(os.getpid(), 0)
        slam = new_system(sequence, args, schedule)
        threads = set(os.listdir("/proc/self/task"))
        own, began = time.process_time(), time.perf_counter()
        recorder = open_recorder(f"{folder}/run.{kind}", slam) if kind else None
        if args.apart and recorder:
            pin(recorder._child.pid, 1)
            for thread in set(os.listdir("/proc/self/task")) - threads:  # that of the pipe
                os.sched_setaffinity(int(thread), {1})
        first = time.perf_counter()
        for frame in frames:
            slam.feed_frame(frame)
        fed = time.perf_counter()
        slam.finish()
        finished = time.perf_counter()
        if recorder:
            recorder.close()
        end = time.perf_counter()
        return {"clock": end - first, "feeding": fed - first, "close": end - finished,
                "start": first - began, "own": time.process_time() - own,
                "drawing": recorder.drawing_s if recorder else 0.0}


def middle(values: np.ndarray) -> str:
    """Median with its 95 % interval."""
    rng = np.random.default_rng(1)
    low, high = np.percentile(np.median(rng.choice(values, (4000, len(values))), axis=1),
                              (2.5, 97.5))
    return f"{np.median(values):+.1f} [{low:+.1f}, {high:+.1f}] %"


def compare_runs(sequence: kys_slam.Sequence, frames: list, args) -> None:
    kinds = ["", *args.kinds]
    runs = {(s, k): [] for s in args.schedules for k in kinds}
    for kind in args.kinds:
        whole_run(sequence, frames, args, args.schedules[0], kind)  # files are read once
    for n in range(args.rounds):
        for schedule in args.schedules:
            order = kinds[n % len(kinds):] + kinds[:n % len(kinds)]
            for kind in order if n % 2 else order[::-1]:
                runs[schedule, kind].append(whole_run(sequence, frames, args, schedule, kind))
    print(f"{args.rounds} rounds of {len(frames)} frames, load {os.getloadavg()[0]:.1f}")
    for schedule in args.schedules:
        plain = {key: np.array([r[key] for r in runs[schedule, ""]]) for key in ("clock", "feeding",
                                                                               "own")}
        print(f"{schedule}: without {np.median(plain['clock']):.3f} s")
        for kind in args.kinds:
            r = {key: np.array([r[key] for r in runs[schedule, kind]])
                 for key in runs[schedule, kind][0]}
            per_frame = 1000 / len(frames)
            print(f"  {kind:<5} whole run {middle(100 * (r['clock'] / plain['clock'] - 1))}, feeding "
                  f"alone {middle(100 * (r['feeding'] / plain['feeding'] - 1))}\n"
                  f"        ms of processor per frame: this process "
                  f"{per_frame * np.median(r['own'] - plain['own']):+.2f}, the one that draws "
                  f"{per_frame * np.median(r['drawing']):.2f}; ms by the clock: start "
                  f"{1000 * np.median(r['start']):.0f}, close {1000 * np.median(r['close']):.0f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sequence", type=Path)
    parser.add_argument("--priors")
    parser.add_argument("--mode")
    parser.add_argument("--schedules", nargs="+", default=["pipelined"])
    parser.add_argument("--frames", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--kinds", nargs="+", default=["rrd", "mcap"])
    parser.add_argument("--whole", action="store_true", help="compare whole runs")
    parser.add_argument("--apart", action="store_true",
                        help="with --whole: the system on one core, recording on another")
    args = parser.parse_args()
    sequence = kys_slam.open_sequence(args.sequence, frames=args.frames)
    (compare_runs if args.whole else compare_frames)(sequence, list(sequence), args)


if __name__ == "__main__":
    main()
