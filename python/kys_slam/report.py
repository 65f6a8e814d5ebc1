"""One HTML page of runs: figures, paths, errors over time, what each frame cost."""

import base64
import csv
import html
import io
import json
from pathlib import Path
from typing import Dict, List

import numpy as np

from ._core import InputError, evaluate, read_tum

_STYLE = """body { font: 15px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em }
table { border-collapse: collapse } td, th { border-bottom: 1px solid #ccc; padding: .2em .8em;
text-align: right } td:first-child, th:first-child { text-align: left } img { max-width: 100% }"""


class _Run:
    def __init__(self, folder: Path) -> None:
        self.name = folder.resolve().name
        try:
            self.summary = json.loads((folder / "summary.json").read_text())
            with open(folder / "frames.csv", newline="") as file:
                rows = list(csv.DictReader(file))
            self.frames = {key: np.array([float(r[key]) for r in rows]) for key in
                           ("timestamp", "matches", "inliers", "ms_total")}
            self.lost = np.array([r["status"] == "lost" for r in rows], bool)
        except OSError as error:
            raise InputError(f"{folder}: not the folder of a run "
                             f"({Path(error.filename).name} is missing)") from None
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(f"{folder}: its summary.json or frames.csv is damaged: {error}") from None
        self.times, self.poses = read_tum(folder / "trajectory.tum")
        truth = folder / "ground_truth.tum"
        self.truth = read_tum(truth) if truth.exists() else None
        self.figures = None
        if self.truth and len(self.times) > 2:
            figures = evaluate(*self.truth, self.times, self.poses)
            self.figures = figures if figures["pairs"] > 2 else None


def aligned_truth(truth, times: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Positions (N, 3) m of the ground truth in the estimate's frame (least squares, SE(3))."""
    nearest = np.clip(np.searchsorted(truth[0], times), 0, len(truth[0]) - 1)
    a, b = truth[1][nearest][:, :3, 3], poses[:, :3, 3]
    u, _, vt = np.linalg.svd((b - b.mean(0)).T @ (a - a.mean(0)))
    r = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    return (truth[1][:, :3, 3] - a.mean(0)) @ r.T + b.mean(0)


def _cell(value, form: str) -> str:
    return "" if value is None else format(value, form)


def _table(runs: List[_Run]) -> str:
    rows = ["<tr><th>run</th><th>mode</th><th>frames tracked</th><th>keyframes</th><th>loops</th>"
            "<th>path, m</th><th>ATE, m</th><th>RPE, m</th><th>ms per frame</th></tr>"]
    for run in runs:
        s, f = run.summary, run.figures
        cells = [html.escape(run.name), html.escape(str(s.get("mode", ""))),
                 f"{s.get('frames_tracked')} of {s.get('frames')}", str(s.get("keyframes")),
                 str(s.get("loops_closed")), _cell(s.get("path_length_m"), ".1f"),
                 _cell(f and f["ate_m"]["rmse"], ".4f"),
                 _cell(f and f["rpe_translation_m"]["rmse"], ".4f"),
                 _cell(float(np.median(run.frames["ms_total"])), ".1f")]
        rows.append("<tr>" + "".join(f"<td>{c}</td>" for c in cells) + "</tr>")
    return "<table>" + "\n".join(rows) + "</table>"


def _pictures(runs: List[_Run]) -> Dict[str, str]:
    """PNGs, base64, by their caption."""
    try:
        import matplotlib
        matplotlib.use("Agg")
        from matplotlib import pyplot as plt
    except ImportError:
        raise InputError("reports need matplotlib: pip install matplotlib") from None
    pictures = {}

    def add(caption: str, figure) -> None:
        out = io.BytesIO()
        figure.savefig(out, format="png", dpi=110, bbox_inches="tight")
        plt.close(figure)
        pictures[caption] = base64.b64encode(out.getvalue()).decode()

    figure, axes = plt.subplots(figsize=(8, 6))
    drawn = False
    for run in runs:
        axes.plot(run.poses[:, 0, 3], run.poses[:, 2, 3], label=run.name, linewidth=1.2)
        if run.figures and not drawn:
            truth = aligned_truth(run.truth, run.times, run.poses)
            axes.plot(truth[:, 0], truth[:, 2], "k--", label="ground truth", linewidth=0.9)
            drawn = True
    axes.set(xlabel="x, m", ylabel="z, m")
    axes.set_aspect("equal", "datalim")
    axes.legend(), axes.grid(alpha=0.3)
    add("Paths, seen from above", figure)
    for key, caption in (("inliers", "Landmarks in the pose of each frame; red: lost"),
                         ("ms_total", "Tracking time per frame, ms")):
        figure, axes = plt.subplots(figsize=(8, 2.6))
        for run in runs:
            t = run.frames["timestamp"] - run.frames["timestamp"][:1]
            axes.plot(t, run.frames[key], linewidth=0.9, label=run.name)
            if key == "inliers":
                axes.plot(t[run.lost], run.frames[key][run.lost], "r.")
        axes.set(xlabel="s")
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
        add(caption, figure)
    return pictures


def write_report(folders: List[Path], output: Path) -> None:
    """Writes the page. Raises InputError for folders that hold no complete run."""
    runs = [_Run(folder) for folder in folders]
    parts = ["<!DOCTYPE html><html lang='en'><head><meta charset='utf-8'><title>KYS-SLAM</title>",
             f"<style>{_STYLE}</style></head><body><h1>Runs</h1>", _table(runs)]
    for run in runs:
        if not run.summary.get("complete", True):
            parts.append(f"<p>{html.escape(run.name)} is not complete: "
                         f"{html.escape(str(run.summary.get('end_reason')))}</p>")
        left_out = run.summary.get("left_out") or {}
        if left_out:
            counts = ", ".join(f"{what} {count}" for what, count in left_out.items())
            parts.append(f"<p>{html.escape(run.name)}, not used: {html.escape(counts)}</p>")
    for caption, png in _pictures(runs).items():
        parts.append(f"<h2>{html.escape(caption)}</h2>"
                     f"<img alt='{html.escape(caption)}' src='data:image/png;base64,{png}'>")
    output.write_text("\n".join(parts) + "</body></html>\n")
