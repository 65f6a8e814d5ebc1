"""What recording costs the thread that feeds: runs with and without, in turns, on one sequence.

    python recording_cost.py SEQUENCE [--priors DIR] [--frames 50] [--rounds 5] [--kinds rrd mcap]

Prints processor time of the feeding thread and wall time per frame, and how much a recording adds:
mean over rounds of the ratio to the run without, and its standard error.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

import kys_slam
from kys_slam.record import open_recorder


def measure(sequence: kys_slam.Sequence, frames: list, args, kind: str) -> tuple:
    """(processor time of this thread, wall time), s, of feeding all frames."""
    settings = kys_slam.Settings({"kys.mode": args.mode or ("kys" if args.priors else "stock")})
    with tempfile.TemporaryDirectory() as folder:
        slam = kys_slam.System(sequence.camera, settings, args.schedule, args.priors)
        recorder = None if kind == "none" else open_recorder(f"{folder}/run.{kind}", slam)
        cpu = wall = 0.0
        for frame in frames:
            c, w = time.thread_time(), time.perf_counter()
            slam.feed_frame(frame)
            cpu, wall = cpu + time.thread_time() - c, wall + time.perf_counter() - w
        slam.finish()
        if recorder:
            recorder.close()
        return cpu, wall


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sequence", type=Path)
    parser.add_argument("--priors")
    parser.add_argument("--mode")
    parser.add_argument("--schedule", default="pipelined")
    parser.add_argument("--frames", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--kinds", nargs="+", default=["rrd", "mcap"])
    args = parser.parse_args()
    sequence = kys_slam.open_sequence(args.sequence, frames=args.frames)
    frames = list(sequence)
    kinds = ["none", "none again", *args.kinds]
    measure(sequence, frames, args, "none")  # warms up
    times = {kind: [] for kind in kinds}
    for i in range(args.rounds):
        for kind in (kinds if i % 2 == 0 else kinds[::-1]):
            times[kind].append(measure(sequence, frames, args, kind.split()[0]))
    base = np.array(times["none"])
    for kind in kinds:
        t = np.array(times[kind])
        ratio = 100 * (t / base - 1)
        error = ratio.std(axis=0, ddof=1) / np.sqrt(len(ratio)) if len(ratio) > 1 else [np.nan] * 2
        cpu, wall = 1000 * np.median(t, axis=0) / len(frames)
        print(f"{kind:<11} {cpu:7.2f} ms of the feeding thread ({ratio[:, 0].mean():+.1f} +- "
              f"{error[0]:.1f} %)   {wall:7.2f} ms by the clock ({ratio[:, 1].mean():+.1f} +- "
              f"{error[1]:.1f} %)")


if __name__ == "__main__":
    main()
