# SPDX-License-Identifier: BSD-3-Clause
"""Paths and errors of one or several runs over ground truth. evo (evo.core) associates, aligns and
measures; matplotlib draws."""

from pathlib import Path
from typing import List, NamedTuple, Optional

import numpy as np

from ._core import InputError, read_tum
from .labels import label_of

MAX_DIFFERENCE = 0.01  #: s, between an estimate and its ground truth


class CannotAlign(InputError):
    """The two trajectories have too little in common."""


class Path3D(NamedTuple):
    """A trajectory."""

    times: np.ndarray  #: (N,) s
    poses: np.ndarray  #: (N, 4, 4)


class RunPaths(NamedTuple):
    """The trajectories of a run as its files have them."""

    folder: Path  #: or a TUM file
    own: Path3D
    reference: Optional[Path]  #: file of the truth
    truth: Optional[Path3D]


class PlottedRun(NamedTuple):
    """A run as it is drawn."""

    name: str
    path: Path3D  #: aligned with the truth where there is one
    truth: Optional[Path3D]
    error_times: np.ndarray  #: (M,) s
    errors: np.ndarray  #: (M,) m, distance from the truth
    figures: dict  #: of evo: rmse, mean, median, std, min, max, sse, m; empty without truth

    @property
    def label(self) -> str:
        if len(self.path.times) == 0:
            return f"{self.name}: lost"
        return self.name + (f": ATE {self.figures['rmse']:.3f} m" if self.figures else "")


def read_trajectory(path: Path) -> Path3D:
    """Of a run's folder or a TUM file."""
    if path.is_dir() and not (path / "trajectory.tum").exists():
        raise InputError(f"{path}: not the folder of a run (no trajectory.tum); "
                         f"kys-slam run {path} tracks a recording")
    return Path3D(*read_tum(path / "trajectory.tum" if path.is_dir() else path))


def _evo():
    try:
        from evo.core import metrics, sync, trajectory
    except ImportError:
        raise InputError("plots over ground truth need evo: pip install evo") from None
    return metrics, sync, trajectory


def read_run(path: Path, reference: Optional[Path] = None) -> RunPaths:
    """reference: a TUM file; None: the run's own ground truth, if it has one."""
    own = read_trajectory(path)
    if reference is None and path.is_dir() and (path / "ground_truth.tum").exists():
        reference = path / "ground_truth.tum"
    truth = None if reference is None else Path3D(*read_tum(reference))
    return RunPaths(path, own, reference, truth)


def without_figures(run: RunPaths, truth: Optional[Path3D] = None) -> PlottedRun:
    """The run as it was tracked, without errors. truth: is drawn beside it."""
    return PlottedRun(label_of(run.folder), run.own, truth, np.empty(0), np.empty(0), {})


def align_run(run: RunPaths, align: str = "se3") -> PlottedRun:
    """align: se3, sim3 or none. Raises CannotAlign when run and truth have too few times in common; a
    run that is lost in all frames has no figures."""
    path, estimate, reference, truth = run
    if truth is None:
        return without_figures(run)
    if len(truth.times) == 0:
        raise CannotAlign(f"{reference}: has no poses")
    if len(estimate.times) == 0:
        return without_figures(run, truth)
    metrics, sync, trajectory = _evo()
    as_evo = [trajectory.PoseTrajectory3D(poses_se3=list(p.poses), timestamps=p.times)
              for p in (truth, estimate)]
    try:
        there, own = sync.associate_trajectories(*as_evo, max_diff=MAX_DIFFERENCE)
    except sync.SyncException:
        raise CannotAlign(f"{path}: has no times in common with {reference} ({estimate.times[0]:.3f} to "
                          f"{estimate.times[-1]:.3f} s, {truth.times[0]:.3f} to {truth.times[-1]:.3f} s)"
                          ) from None
    if own.num_poses < 3:
        raise CannotAlign(f"{path}: {own.num_poses} poses have ground truth, too few to align")
    whole = as_evo[1]
    if align != "none":
        try:
            r, t, scale = own.align(there, correct_scale=align == "sim3")
        except Exception as error:  # evo: degenerate, e.g. all positions in one place
            raise CannotAlign(f"{path}: cannot be aligned with {reference}: {error}") from None
        whole.scale(scale)
        whole.transform(np.block([[r, t.reshape(3, 1)], [np.zeros((1, 3)), np.ones((1, 1))]]))
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data((there, own))
    return PlottedRun(label_of(path), Path3D(estimate.times, np.array(whole.poses_se3)), truth,
                      own.timestamps, np.asarray(error.error), error.get_all_statistics())


def load_run(path: Path, reference: Optional[Path], align: str = "se3") -> PlottedRun:
    """A run that is read and aligned: read_run, align_run."""
    return align_run(read_run(path, reference), align)


def _plane(runs: List[PlottedRun]) -> tuple:
    """The two axes along which the paths are longest."""
    positions = np.concatenate([(run.truth or run.path).poses[:, :3, 3] for run in runs])
    if len(positions) == 0:
        return (0, 2)
    axes = sorted(np.argsort(np.ptp(positions, axis=0))[1:])
    return (int(axes[0]), int(axes[1]))


def pyplot():
    """matplotlib.pyplot, for pictures without a display; a dollar in a name begins no formula."""
    try:
        import matplotlib
        matplotlib.use("Agg")
        from matplotlib import pyplot as plt
    except ImportError:
        raise InputError("plots need matplotlib: pip install matplotlib") from None
    plt.rcParams["text.parse_math"] = False
    return plt


def draw_paths(runs: List[PlottedRun], axes) -> list:
    """Paths from where they are seen best, with their truth; the colours of the runs."""
    i, k = _plane(runs)
    judged = [run for run in runs if run.truth is not None]
    drawn = []
    for run in judged:
        if not any(np.array_equal(run.truth.poses, d) for d in drawn):
            axes.plot(run.truth.poses[:, i, 3], run.truth.poses[:, k, 3], "k--", linewidth=1.0,
                      label="ground truth" if not drawn else f"ground truth of {run.name}")
            drawn.append(run.truth.poses)
    colours = [axes.plot(run.path.poses[:, i, 3], run.path.poses[:, k, 3], linewidth=1.2,
                         label=run.label)[0].get_color() for run in runs]
    axes.set(xlabel=f"{'xyz'[i]}, m", ylabel=f"{'xyz'[k]}, m")
    axes.set_aspect("equal", "datalim")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
    return colours


def draw(runs: List[PlottedRun], file: Path) -> None:
    """A picture: paths; with truth, errors over time."""
    plt = pyplot()
    judged = any(run.truth is not None for run in runs)
    figure, panels = plt.subplots(2 if judged else 1, 1, figsize=(8, 9.5 if judged else 7),
                                  height_ratios=[3, 1] if judged else [1], squeeze=False)
    for run, colour in zip(runs, draw_paths(runs, panels[0, 0])):
        if run.figures:
            panels[1, 0].plot(run.error_times - run.error_times[0], run.errors, linewidth=0.9,
                              color=colour)
    if judged:
        panels[1, 0].set(xlabel="time, s", ylabel="position error, m")
        panels[1, 0].set_ylim(bottom=0)
        panels[1, 0].grid(alpha=0.3)
    try:
        figure.savefig(file, dpi=150, bbox_inches="tight")
    except (OSError, ValueError) as error:
        raise InputError(f"cannot write {file}: {error}") from None
    finally:
        plt.close(figure)
