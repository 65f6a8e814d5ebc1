# SPDX-License-Identifier: BSD-3-Clause
"""The command `kys-slam map`: calls the programs for saved maps, and draws what evaluate_map finds."""

import tempfile
from pathlib import Path
from typing import List, Optional, Tuple

import kys_slam
from kys_slam import InputError
from kys_slam.programs import find_program, run_program

#: What is done, and by which program.
PROGRAMS = {"info": "map_info", "refine": "refine_map", "evaluate": "evaluate_map", "merge": "merge_maps"}


def map_command(args) -> int:
    """Returns the program's exit status."""
    program = find_program(PROGRAMS[args.action])
    arguments = list(args.arguments)
    if args.action != "evaluate":
        return run_program([program, *arguments])
    plot, arguments = _take_option(arguments, "--plot")
    if not plot:
        return run_program([program, *arguments])
    kys_slam.check_writable(plot)
    with tempfile.TemporaryDirectory(prefix="kys-evaluate-") as folder:
        ply, arguments = _take_option(arguments, "--ply")
        ply = ply or str(Path(folder) / "errors.ply")
        status = run_program([program, *arguments, "--ply", ply])
        if status == 0:
            draw_errors(ply, plot)
            print(f"wrote {plot}")
    return status


def _take_option(arguments: List[str], name: str) -> Tuple[Optional[str], List[str]]:
    """The value of an option, and the arguments without it."""
    for k, argument in enumerate(arguments):
        if argument.startswith(name + "="):
            return argument[len(name) + 1:], arguments[:k] + arguments[k + 1:]
        if argument == name:
            if k + 1 == len(arguments):
                raise InputError(f"{name}: its file is missing")
            return arguments[k + 1], arguments[:k] + arguments[k + 2:]
    return None, arguments


def draw_errors(ply: str, output: str) -> None:
    """Draws the map of evaluate_map's --ply, seen along the direction in which it extends least."""
    try:
        import matplotlib
    except ImportError:
        raise InputError("--plot needs Matplotlib: pip install matplotlib") from None
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np
    from kys_slam.maps import read_map
    points = read_map(ply).points
    xyz = np.stack([points[c] for c in "xyz"], axis=1).astype(float)
    low, high = np.percentile(xyz, [1, 99], axis=0)
    across = int(np.argmin(high - low))
    first, second = [c for c in range(3) if c != across]
    order = np.argsort(points["error"])  # large errors on top
    figure, axes = plt.subplots(figsize=(9, 6), layout="constrained")
    shown = axes.scatter(xyz[order, first], xyz[order, second], c=100 * points["error"][order], s=2,
                         cmap="RdYlGn_r", vmin=0, vmax=20)
    figure.colorbar(shown, label="distance from the true surface, cm")
    margin = 0.05 * (high - low) + 1
    axes.set(xlabel=f"{'xyz'[first]}, m", ylabel=f"{'xyz'[second]}, m", aspect="equal",
             xlim=(low[first] - margin[first], high[first] + margin[first]),
             ylim=(low[second] - margin[second], high[second] + margin[second]))
    figure.savefig(output, dpi=130)
    plt.close(figure)
