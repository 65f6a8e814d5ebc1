# SPDX-License-Identifier: BSD-3-Clause
"""One HTML page of runs: figures, paths, errors over time, what each frame cost."""

import base64
import csv
import html
import io
import json
from pathlib import Path
from typing import Dict, List, Optional

import numpy as np

from ._core import InputError, evaluate
from .labels import label_of
from .plot import (CannotAlign, PlottedRun, RunPaths, align_run, draw_paths, pyplot, read_run,
                   without_figures)

_STYLE = """body { font: 15px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em }
table { border-collapse: collapse } td, th { border-bottom: 1px solid #ccc; padding: .2em .8em;
text-align: right } td:first-child, th:first-child { text-align: left } img { max-width: 100% }"""


_SUMMARY = {"mode": str, "frames": int, "frames_tracked": int, "frames_connected": int, "submaps": int,
            "keyframes": int, "loops_closed": int,
            "path_length_m": (int, float), "complete": bool, "end_reason": str, "left_out": dict}


def _read_summary(file: Path) -> dict:
    """Raises ValueError when it is not the summary of a run."""
    summary = json.loads(file.read_text(encoding="utf-8"))
    if not isinstance(summary, dict):
        raise ValueError("no summary of a run")
    for key, kind in _SUMMARY.items():
        if not isinstance(summary.get(key), (kind, type(None))):
            raise ValueError(f"{key} is {json.dumps(summary[key])[:40]}")
    return summary


def _align(paths: RunPaths) -> PlottedRun:
    """Aligned with its ground truth, if it has one and can be aligned."""
    try:
        return align_run(paths)
    except CannotAlign:
        return without_figures(paths)


def _figures(paths: RunPaths) -> Optional[dict]:
    """Errors; None without ground truth or with too few poses."""
    if paths.truth is None or len(paths.own.times) <= 2:
        return None
    figures = evaluate(*paths.truth, *paths.own)
    return figures if figures["pairs"] > 2 else None


class _Run:
    def __init__(self, folder: Path) -> None:
        self.name = label_of(folder)
        try:
            self.summary = _read_summary(folder / "summary.json")
            with open(folder / "frames.csv", newline="", encoding="utf-8") as file:
                rows = list(csv.DictReader(file))
            self.frames = {key: np.array([float(r[key]) for r in rows]) for key in
                           ("timestamp", "matches", "inliers", "ms_total")}
            self.lost = np.array([r["status"] == "lost" for r in rows], bool)
        except OSError as error:
            raise InputError(f"{folder}: not the folder of a run "
                             f"({Path(error.filename).name}: {error.strerror})") from None
        except (ValueError, KeyError, TypeError, RecursionError, csv.Error) as error:
            raise InputError(f"{folder}: its summary.json or frames.csv is damaged: {error}") from None
        paths = read_run(folder)
        self.plotted, self.figures = _align(paths), _figures(paths)


def _cell(value, form: str = "") -> str:
    return "" if value is None else html.escape(format(value, form))


def _pieces(summary: dict) -> str:
    """Of a run in several sub-maps, how many frames the trajectory has."""
    if not (summary.get("submaps") or 0) > 1:
        return ""
    return _cell(f", {summary.get('frames_connected')} connected, {summary['submaps']} sub-maps")


def _table(runs: List[_Run]) -> str:
    rows = ["<tr><th>run</th><th>mode</th><th>frames tracked</th><th>keyframes</th><th>loops</th>"
            "<th>path, m</th><th>ATE, m</th><th>RPE, m</th><th>ms per frame</th></tr>"]
    for run in runs:
        s, f = run.summary, run.figures
        times = run.frames["ms_total"]
        cells = [_cell(run.name), _cell(s.get("mode")),
                 _cell(s.get("frames_tracked")) + " of " + _cell(s.get("frames")) + _pieces(s),
                 _cell(s.get("keyframes")), _cell(s.get("loops_closed")),
                 _cell(s.get("path_length_m"), ".1f"),
                 _cell(f and f["ate_m"]["rmse"], ".4f"),
                 _cell(f and f["rpe_translation_m"]["rmse"], ".4f"),
                 _cell(float(np.median(times)) if len(times) else None, ".1f")]
        rows.append("<tr>" + "".join(f"<td>{c}</td>" for c in cells) + "</tr>")
    return "<table>" + "\n".join(rows) + "</table>"


def _pictures(runs: List[_Run]) -> Dict[str, str]:
    """PNGs, base64, by their caption."""
    plt = pyplot()
    pictures = {}

    def add(caption: str, figure) -> None:
        out = io.BytesIO()
        figure.savefig(out, format="png", dpi=110, bbox_inches="tight")
        plt.close(figure)
        pictures[caption] = base64.b64encode(out.getvalue()).decode()

    figure, axes = plt.subplots(figsize=(8, 6))
    draw_paths([run.plotted for run in runs], axes)
    add("Paths", figure)
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
    output.write_text("\n".join(parts) + "</body></html>\n", encoding="utf-8", errors="replace")
