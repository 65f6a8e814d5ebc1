"""What recording costs the thread that feeds: every frame with and without, on one sequence.

    python recording_cost.py SEQUENCE [--priors DIR] [--frames 50] [--rounds 8] [--kinds rrd mcap]

Of two runs one records the even frames, the other one the odd ones; each frame is compared with
itself, so what differs from run to run falls out. Prints how much a recorded frame adds to the
processor time of the feeding thread and to the time by the clock: mean over rounds and its standard
error. The process that draws works on half of the frames then: by the clock a whole recording costs
more where it shares the processor.
"""

import argparse
import tempfile
import time
from pathlib import Path
from typing import Tuple

import numpy as np

import kys_slam
from kys_slam.record import open_recorder

WARM_UP = 2  # frames


def measure(sequence: kys_slam.Sequence, frames: list, args, kind: str, odd: int) -> np.ndarray:
    """(N, 2) processor time of this thread and wall time of feeding each frame, s."""
    settings = kys_slam.Settings({"kys.mode": args.mode or ("kys" if args.priors else "stock")})
    times = []
    with tempfile.TemporaryDirectory() as folder:
        slam = kys_slam.System(sequence.camera, settings, args.schedule, args.priors)
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
    runs = {odd: measure(sequence, frames, args, kind, odd) for odd in (first, 1 - first)}
    odd_frame = (np.arange(len(frames)) % 2 == 1)[:, None]
    on = np.where(odd_frame, runs[1], runs[0])
    off = np.where(odd_frame, runs[0], runs[1])
    return on[WARM_UP:].mean(0), off[WARM_UP:].mean(0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sequence", type=Path)
    parser.add_argument("--priors")
    parser.add_argument("--mode")
    parser.add_argument("--schedule", default="pipelined")
    parser.add_argument("--frames", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--kinds", nargs="+", default=["rrd", "mcap"])
    args = parser.parse_args()
    sequence = kys_slam.open_sequence(args.sequence, frames=args.frames)
    frames = list(sequence)
    for kind in args.kinds:
        rounds = [one_round(sequence, frames, args, kind, k % 2) for k in range(args.rounds)]
        ratio = np.array([100 * (on / off - 1) for on, off in rounds])
        mean = ratio.mean(0)
        error = (ratio.std(0, ddof=1) / np.sqrt(len(ratio)) if len(ratio) > 1
                 else np.full(2, np.nan))
        cpu = 1000 * np.mean([off[0] for _, off in rounds])
        print(f"{kind:<5} {mean[0]:+.1f} +- {error[0]:.1f} % of {cpu:.2f} ms of the feeding thread, "
              f"{mean[1]:+.1f} +- {error[1]:.1f} % by the clock")


if __name__ == "__main__":
    main()
