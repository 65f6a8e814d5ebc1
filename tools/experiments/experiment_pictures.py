# SPDX-License-Identifier: BSD-3-Clause
"""Figures of one experiment."""
import os
import shutil

import figures
from experiment_tables import splits
from results import ORIGINS, published, select, unique
from runs import read_json


def pictures(experiment, results, rows, folder):
    name, made = experiment["name"], []
    path = lambda what: os.path.join(folder, f"{name}-{what}.png")
    if experiment.get("kind") == "costs":
        return []
    if experiment.get("kind") == "survey":
        return [m for m in survey_pictures(results, rows, path) if m]
    for k, (labels, words, mine) in enumerate(splits(experiment, rows)):
        if "sweep" in experiment:
            values = [str(v["name"]) for v in experiment["sweep"]["values"]]
            numbers = published(experiment["published"]) if "published" in experiment else []
            made.append(figures.sweep(mine, values, experiment["baseline"], numbers,
                                      f"{experiment['title']}; {words}", path(f"sweep-{k + 1}")))
    box_key = "case" if len(unique(rows, "case")) > 1 else "input"
    for origin in unique(rows, "origin"):
        for variant in unique(rows, "variant"):
            mine = select(rows, origin=origin, variant=variant)
            if len(mine) > 1:
                words = ", ".join(w for w in (ORIGINS[origin], variant) if w)
                made.append(figures.boxes(mine, box_key, "configuration", "ATE, m",
                                          f"{experiment['title']}; {words}",
                                          path(f"box-{origin}-{variant}".replace(" ", "-"))))
    if "sweep" not in experiment:
        made += trajectory_pictures(experiment, results, rows, path)
    return [m for m in made if m]


def survey_pictures(results, rows, path):
    """Survival over the sequence, distributions of m and mu, a frame's stages."""
    made, frames, scores, mu = [], [], [], []
    found = [(r, read_json(os.path.join(results.folder(r), "values.json"))) for r in rows]
    found = [(r, values) for r, values in found if values is not None]
    # The pictures of a frame: first where most objects are flagged.
    for r, values in sorted(found, key=lambda f: -f[1]["flagged_pixels"]):
        label = f"{r['input']} ({r.get('what', 'given data')})"
        frames.append((label, values["survival_per_frame"]))
        scores.append((label, values["m"]))
        mu.append((label, values["mu"]))
        for what in ("stages", "tiers"):
            source = os.path.join(results.folder(r), what + ".png")
            if os.path.exists(source) and len(frames) <= 2:
                copy = path(f"{what}-{r['input'].replace('/', '')}")
                shutil.copyfile(source, copy)
                made.append(copy)
    if not frames:
        return []
    return [figures.over_frames(frames, "keypoints with mu up to 8, %", "Survival under the stereo gate",
                                path("survival")),
            figures.cumulative(scores, [], "m of flagged objects", "Motion score", path("m")),
            figures.cumulative(mu, [8, 20], "mu of the pixels of flagged objects",
                               "Exported motion prior; dotted: the gates", path("mu")), *made]


def trajectory_pictures(experiment, results, rows, path, limit=3):
    """The first inputs' trajectories, exact perception, first seed and variant."""
    made = []
    first = {k: rows[0][k] for k in ("variant", "case", "repeat")} if rows else {}
    for name in unique(rows, "input")[:limit]:
        mine = [r for r in select(rows, input=name, **first)
                if r["status"] in ("done", "lost") and r["schedule"] == rows[0]["schedule"]]
        mine = [r for r in mine if r["seed"] == mine[0]["seed"]]
        if mine:
            of = ", ".join(x for x in (mine[0]["variant"], mine[0]["case"]) if x)
            made.append(figures.trajectories(
                [(r["configuration"], results.folder(r)) for r in mine[:8]],
                f"{name}: {mine[0].get('what', 'given data')} ({of})",
                path(f"path-{name.replace('/', '')}")))
    return made
