#!/usr/bin/env python3
"""Tables, figures and the report of a work folder (plan.py), complete or not.

    report.py WORK

Writes WORK/report.html, one file with everything in it; the tables in WORK/tables as CSV, Markdown
and LaTeX, with every run as a row of NAME.runs.csv; the figures in WORK/figures as PNG.
"""
import base64
import html
import itertools
import json
import os
import re
import shutil
import sys
import time

import numpy as np

import figures
from paired import deviation, difference, mean
from results import (METRICS, ORIGINS, Results, over_repeats, pairs, published, select, unique)
from runs import InputError, read_json, write_text
from tables import Table, show

RUN_COLUMNS = ["origin", "input", "what", "seed", "configuration", "variant", "case", "schedule",
               "repeat", "status", "reason", "ate", "rpe_m", "rpe_deg", "tracked", "keyframes", "loops",
               "loops_true", "revisits", "revisits_tied", "wall_s", "peak_mb", "survival_8",
               "survival_20", "job"]
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 92rem; margin: 2rem auto; padding: 0 1rem;
  color: #1b1b1b; }
h1, h2 { line-height: 1.2; } h2 { margin-top: 3rem; border-top: 2px solid #ddd; padding-top: 1rem; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 12.5px; display: block;
  overflow-x: auto; }
caption { text-align: left; font-weight: 600; padding: .3rem 0; }
th, td { padding: .2rem .55rem; text-align: right; border-bottom: 1px solid #eee; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; } thead th { border-bottom: 2px solid #888; }
tr.group td { text-align: left; font-style: italic; background: #f4f4f4; }
p.note { font-size: 12.5px; color: #555; margin-top: -.5rem; } img { max-width: 100%; }
.warning { background: #fff4d6; padding: .4rem .8rem; }
nav a { margin-right: 1rem; } ul.columns { columns: 3; font-size: 13px; }
"""


# --- tables of one experiment -------------------------------------------------------------------


def cell(rows, metric):
    """Mean over seeds, its deviation, and what went wrong."""
    failed = [r for r in rows if r["status"] in ("failed", "missing")]
    values = [v for v in over_repeats(rows, metric).values() if v is not None]
    text = show(mean(values)) if values else ""
    if len(values) > 1:
        text += f" ± {show(deviation(values))}"
    tracked = mean([r.get("tracked") for r in rows])
    if tracked is not None and tracked < 99.95:
        text += f" ({tracked:.0f} %)"
    if failed:
        one = failed[0]["status"] if len(failed) == len(rows) else f"{len(failed)} failed"
        text = f"{text} {one}".strip()
    return text or "-"


def splits(experiment, rows, apart=("variant", "schedule")):
    """What goes into one table: origins are never mixed, nor the labels `apart`, nor what `per` names."""
    keys = ["origin"] + [k for k in apart if len(unique(rows, k)) > 1]
    keys += [k for k in experiment.get("per", []) if k not in keys]
    seen = list(dict.fromkeys(tuple(r[k] for k in keys) for r in rows))
    for values in seen:
        labels = dict(zip(keys, values))
        words = [ORIGINS[labels["origin"]]] + [str(v) for k, v in labels.items()
                                               if k != "origin" and v]
        yield labels, ", ".join(words), select(rows, **labels)


def gain_column(rows, row_key, value, baseline, metric):
    """Mean over inputs of the reduction against the baseline, %, as the paper's average."""
    base = select(rows, **{row_key: baseline})
    mine = select(rows, **{row_key: value})
    _, a, b = pairs(base, mine, metric)
    reductions = [100 * (x - y) / x for x, y in zip(a, b) if x > 0]
    return show(mean(reductions), 1) if reductions else "-"


def value_tables(experiment, rows):
    """A table per split and metric: rows and columns as the experiment says."""
    row_key, column_key = experiment["rows"], experiment["columns"]
    tables = []
    for labels, words, mine in splits(experiment, rows):
        for metric in experiment.get("metrics", ["ate"]):
            name, unit = METRICS[metric]
            columns = unique(mine, column_key)
            with_gain = (row_key == "configuration" and len(unique(mine, row_key)) > 1
                         and experiment.get("baseline") in unique(mine, row_key))
            header = [row_key, *columns] + (["mean reduction %"] if with_gain else [])
            body = []
            for value in unique(mine, row_key):
                line = [value] + [cell(select(mine, **{row_key: value, column_key: c}), metric)
                                  for c in columns]
                if with_gain:
                    line.append(gain_column(mine, row_key, value, experiment["baseline"], metric))
                body.append(line)
            groups = {}
            if labels["origin"] == "given":
                add_published(experiment, metric, columns, len(header), body, groups)
            tables.append(Table(
                f"{experiment['name']}-{len(tables) + 1}",
                f"{experiment['title']}: {name}, {unit}; {words}", header, body,
                note_of(mine), groups))
    return tables


def note_of(rows):
    seeds, repeats = len(unique(rows, "seed")), len(unique(rows, "repeat"))
    text = f"Mean ± standard deviation over {seeds} seeds" if seeds > 1 else "One seed"
    text += f", {repeats} runs each" if repeats > 1 else ""
    stand_ins = {r["input"]: r["what"] for r in rows if r["origin"] == "stand-in"}
    text += "; frames tracked in brackets when not all."
    if stand_ins:
        text += " Stand-ins, not to be compared with published figures: " + "; ".join(
            f"{k} = {v.removeprefix('stand-in: ')}" for k, v in stand_ins.items()) + "."
    return text


def add_published(experiment, metric, columns, width, body, groups):
    """Published rows below ours, where the columns are sequences."""
    if "published" not in experiment or experiment["columns"] != "input":
        return
    entries = [p for p in published(experiment["published"]) if p["metric"] == metric]
    last = None
    for key in dict.fromkeys((p["source"], p["section"], p["method"], p["setting"]) for p in entries):
        values = {p["sequence"]: p["value"] for p in entries
                  if (p["source"], p["section"], p["method"], p["setting"]) == key}
        if not any(c in values for c in columns):
            continue
        if key[:2] != last:
            groups[len(body)] = f"published, {key[0]}, {key[1]}"
            last = key[:2]
        line = [f"{key[2]} {key[3]}".strip()] + [show(values.get(c), 3) for c in columns]
        body.append(line + [""] * (width - len(line)))


def published_table(experiment):
    """The published figures by themselves: beside ours, and never in one table with simulations."""
    if "published" not in experiment:
        return []
    entries = published(experiment["published"])
    sequences = [s for s in unique(entries, "sequence")]
    body, groups, last = [], {}, None
    keys = dict.fromkeys((p["source"], p["section"], p["method"], p["setting"], p["metric"], p["unit"])
                         for p in entries)
    for key in keys:
        if key[:2] != last:
            groups[len(body)] = f"{key[0]}, {key[1]}"
            last = key[:2]
        values = {p["sequence"]: p["value"] for p in entries
                  if tuple(p[k] for k in ("source", "section", "method", "setting", "metric",
                                          "unit")) == key}
        name, unit = METRICS[key[4]][0] if key[4] in METRICS else key[4], key[5]
        body.append([f"{key[2]} {key[3]}".strip(), f"{name}, {unit}"]
                    + [show(values.get(s), 3) for s in sequences])
    return [Table(f"{experiment['name']}-published",
                  f"Published ({experiment['paper']}), real recordings",
                  ["method", "figure", *[s or "all" for s in sequences]], body,
                  "KYS-SLAM: Know-Your-Scene SLAM; sources by table and section in "
                  "tools/experiments/published.", groups)]


def paired_rows(label, baseline_rows, rows, metric, ignore=()):
    """One row of the table of paired differences; None without pairs."""
    keys, a, b = pairs(baseline_rows, rows, metric, ignore)
    if not keys:
        return None
    d = difference(a, b)  # of metres; the ratio, its interval, test and verdict are of logarithms
    good = [(x, y) for x, y in zip(a, b) if x > 0 and y > 0]
    ratio = difference([np.log(x) for x, _ in good], [np.log(y) for _, y in good])
    worst = max(range(len(keys)), key=lambda i: b[i] - a[i])
    interval = lambda e, f: show_interval(e, f, lambda v: show(v, 4))
    power = lambda v: None if v is None else float(np.exp(v))
    return label + [
        d.pairs, show(d.mean), interval(d.low, d.high), show(power(ratio.mean), 3),
        interval(power(ratio.low), power(ratio.high)), show_p(ratio.wilcoxon_p),
        f"{show(b[worst] - a[worst])} ({keys[worst][0]}, seed {keys[worst][1]})",
        show(mean([r.get("tracked") for r in rows]), 1), ratio.verdict]


def show_interval(low, high, form):
    return "-" if low is None else f"{form(low)} to {form(high)}"


def show_p(p):
    return "< 0.001" if p is not None and p < 0.001 else show(p, 3)


PAIRED_HEADER = ["pairs", "mean difference, m", "95 %", "ratio", "95 %", "Wilcoxon p", "worst",
                 "tracked %", "by the ratio"]


def paired_tables(experiment, rows):
    """Every configuration less the baseline; every variant less the first."""
    baseline = experiment.get("baseline")
    tables = []
    for labels, words, mine in splits(experiment, rows):
        body = []
        cases = unique(mine, "case")
        for configuration in unique(mine, "configuration"):
            if configuration == baseline:
                continue
            for case in cases:
                row = paired_rows([configuration, case], select(mine, configuration=baseline, case=case),
                                  select(mine, configuration=configuration, case=case), "ate")
                if row:
                    body.append(row)
        if body:
            tables.append(Table(
                f"{experiment['name']}-paired-{len(tables) + 1}",
                f"Paired difference of ATE to {baseline}; {words}",
                ["configuration", "case", *PAIRED_HEADER], body,
                "Same input, seed and case. Ratio: geometric mean of ATE over the baseline's, tested by "
                "Wilcoxon's signed ranks of its logarithms; intervals: bootstrap over pairs."))
    return tables + variant_tables(experiment, rows)


def variant_tables(experiment, rows):
    variants = unique(rows, "variant")
    if len(variants) < 2:
        return []
    tables = []
    for _, words, group in splits({}, rows, apart=("schedule",)):
        body = []
        for other in variants[1:]:
            for configuration in unique(group, "configuration"):
                for case in unique(group, "case"):
                    mine = select(group, configuration=configuration, case=case)
                    row = paired_rows([configuration, case], select(mine, variant=variants[0]),
                                      select(mine, variant=other), "ate", ignore=("variant",))
                    if row:
                        body.append(row)
        if body:
            tables.append(Table(
                f"{experiment['name']}-variants-{len(tables) + 1}",
                f"Paired difference of ATE, {', '.join(variants[1:])} to {variants[0]}; "
                f"{words}", ["configuration", "case", *PAIRED_HEADER], body))
    return tables


def best_tables(experiment, rows):
    """Of a study: where `verified` stands against the best of the others in every cell."""
    if "verified" not in unique(rows, "configuration"):
        return []
    body = []
    cells = dict.fromkeys((r["input"], r["variant"], r["case"]) for r in rows)
    for name, variant, case in cells:
        mine = select(rows, input=name, variant=variant, case=case)
        means = {c: mean(over_repeats(select(mine, configuration=c), "ate").values())
                 for c in unique(mine, "configuration")}
        own = means.pop("verified")
        others = {c: v for c, v in means.items() if v is not None}
        if own is None or not others:
            continue
        best = min(others, key=others.get)
        within = own <= 1.1 * others[best] + 0.003
        body.append([name, variant, case, show(own), best, show(others[best]),
                     "yes" if within else "NO",
                     show(mean([r.get("tracked") for r in select(mine, configuration="verified")]), 1)])
    return [Table(f"{experiment['name']}-verified",
                  "verified against the best other configuration of the same cell: "
                  "at most 1.1 times plus 3 mm", ["input", "variant", "case", "verified", "best other",
                                                  "its ATE, m", "within", "tracked %"], body),
            wrong_prior_table(experiment, rows)]


def ratio_row(mine, other, own):
    """ATE of `own` over that of `other` in these runs: pairs, ratio ...; None without pairs. A pair is
    an input and seed; of several cases the mean of the logarithms counts once."""
    rows = {c: select(mine, configuration=c) for c in (other, own)}
    logs = {}
    for key, a, b in zip(*pairs(rows[other], rows[own], "ate")):
        if a > 0 and b > 0:
            logs.setdefault(key[:2], []).append(np.log(b / a))
    if not logs:
        return None
    values = [float(np.mean(v)) for v in logs.values()]
    d = difference(np.zeros(len(values)), values)
    form = lambda v: f"{np.exp(v):.2g}"
    return [d.pairs, form(d.mean), show_interval(d.low, d.high, form), show_p(d.wilcoxon_p), d.verdict,
            *[show(mean([r.get("tracked") for r in rows[c]]), 1) for c in (own, other)]]


def wrong_prior_table(experiment, rows):
    """ATE of `verified` over that of each other configuration, with exact and with wrong priors."""
    own = "verified"
    cases = {"exact": ["exact"], "wrong": [c for c in unique(rows, "case") if c != "exact"]}
    others = [c for c in unique(rows, "configuration") if c != own]
    body = []
    for variant, name, priors in itertools.product(unique(rows, "variant"), ["", *unique(rows, "input")],
                                                   cases):
        mine = [r for r in rows if r["variant"] == variant and r["case"] in cases[priors]
                and name in ("", r["input"])]
        for other in others:
            row = ratio_row(mine, other, own)
            if row:
                body.append([name or "all", variant, priors, other, *row])
    return Table(f"{experiment['name']}-exact-wrong",
                 "ATE of verified over that of the others, exact and wrong priors",
                 ["input", "variant", "priors", "other", "pairs", "ratio", "95 %", "Wilcoxon p", "verdict",
                  "verified tracked %", "other tracked %"], body,
                 "Geometric means over inputs and seeds; of an input and seed, over the cases.")


def exposure_tables(experiment, results):
    """Share of keypoints with wrong priors, by case."""
    body, seen = [], set()
    for labels in experiment["runs"]:
        job = results.job(labels["job"])
        priors = job["spec"]["priors"] if job else None
        done = results.done(priors) if priors else {}
        if priors in seen or "exposure_mean" not in done:
            continue
        seen.add(priors)
        body.append([labels["input"], ORIGINS[labels["origin"]], labels["seed"], labels["case"],
                     labels["configuration"], show(done.get("flow_error_px"), 2),
                     show(done["exposure_mean"], 2), show(done["exposure_p95"], 2),
                     show(done["exposure_max"], 2)])
    return [Table(f"{experiment['name']}-exposure", "Keypoints with wrong priors, % of a frame's",
                  ["input", "origin", "seed", "case", "first used by", "flow error, px", "mean",
                   "95th percentile", "maximum"], body)] if body else []


def cost_tables(experiment, results, rows):
    """Milliseconds per stage and memory; fusion from build_priors."""
    stages = ("total", "extract", "priors", "stereo", "track", "local_mapping", "loop")
    body = []
    for r in rows:
        timing = r.get("timing_ms", {})
        job = results.job(r["job"])
        fusion = results.done(job["spec"]["priors"]).get("fusion_ms") if job["spec"]["priors"] else None
        seen = results.done(experiment.get("perception", {}).get(r["input"], ""))
        networks = seen.get("networks_ms") if fusion is not None else None
        classical = seen.get("classical_ms") if fusion is not None else None
        body.append([r["input"], ORIGINS[r["origin"]], r["configuration"]]
                    + [show(timing.get(s, {}).get("mean"), 2) for s in stages]
                    + [show(networks, 0), show(classical, 0), show(fusion, 2),
                       show(r.get("peak_mb"), 0)])
    return [Table(f"{experiment['name']}-stages", "Time per frame, mean, ms, and memory",
                  ["input", "origin", "configuration", *stages, "segmentation (network)",
                   "SGBM + DIS", "fusion (build_priors)", "peak memory, MB"], body,
                  "total: the tracking path of a frame, reading priors included. Beside it, before the "
                  "run, on one core: segmentation where make_priors measured it (given data), disparity "
                  "and flow of both cameras by SGBM and DIS, fusion. The paper gives 1696 ms for its "
                  "networks.")]


def loop_tables(experiment, rows):
    """Loops closed and true, revisits and those tied, where any revisit exists."""
    mine = [r for r in rows if r.get("revisits")]
    if not mine:
        return []
    body = []
    for key in dict.fromkeys((r["origin"], r["configuration"], r["variant"]) for r in mine):
        some = [r for r in mine if (r["origin"], r["configuration"], r["variant"]) == key]
        total = lambda k: sum(r[k] for r in some)
        body.append([ORIGINS[key[0]], key[1], key[2], len(some), total("loops_closed"),
                     total("loops_true"), total("revisits"), total("revisits_tied")])
    return [Table(f"{experiment['name']}-loops", "Loops and revisits, sums over runs with revisits",
                  ["origin", "configuration", "variant", "runs", "loops closed", "of these true",
                   "revisits", "tied by the map"], body)]


def runs_table(experiment, rows):
    digits = lambda v: f"{v:.6g}" if isinstance(v, float) else "" if v is None else str(v)
    return Table(experiment["name"] + ".runs", experiment["title"], RUN_COLUMNS,
                 [[digits(r.get(k)) for k in RUN_COLUMNS] for r in rows])


# --- figures of one experiment ------------------------------------------------------------------


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
                                          path(f"box-{origin}-{variant}")))
    if "sweep" not in experiment:
        made += trajectory_pictures(experiment, results, rows, path)
    return [m for m in made if m]


def survey_pictures(results, rows, path):
    """Survival over the sequence, distributions of m and mu, a frame's stages."""
    made, frames, scores, mu = [], [], [], []
    found = [(r, read_json(os.path.join(results.folder(r), "values.json"))) for r in rows]
    found = [(r, values) for r, values in found if values is not None]
    # The pictures of a frame: first where most things are flagged.
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
            figures.cumulative(scores, [], "m of flagged things", "Motion score", path("m")),
            figures.cumulative(mu, [8, 20], "mu of the pixels of flagged things",
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


# --- the first page -----------------------------------------------------------------------------


def helps(results, experiments):
    """Sentences: KYS against stock on every input group, by origin and variant."""
    body = []
    for experiment, rows in experiments:
        if experiment.get("kind") or "sweep" in experiment:
            continue
        for configuration in ("KYS, literal", "KYS", "mask", "verified"):
            for origin in unique(rows, "origin"):
                for variant in unique(rows, "variant"):
                    mine = select(rows, origin=origin, variant=variant, case="exact",
                                  schedule=rows[0]["schedule"])
                    row = paired_rows([], select(mine, configuration="stock"),
                                      select(mine, configuration=configuration), "ate")
                    if row:
                        body.append([f"{experiment['title']} ({experiment['paper']})", ORIGINS[origin],
                                     variant, configuration, row[0], row[3], row[4], row[5], row[8]])
    return Table("summary", "ATE over that of stock, exact or given perception",
                 ["experiment", "origin", "variant", "configuration", "pairs", "ratio", "95 %",
                  "Wilcoxon p", "verdict"], body,
                 "Below 1: better than stock. The interval decides; pairs of few inputs say little.")


VARIANTS = {"votes": "with vote counting (ORB-SLAM's, the paper's baseline)",
            "balanced": "with balanced consensus (the default here)", "": "with the default settings"}


def all_pairs(experiments, configuration, variant):
    """ATE of stock and of a configuration, exact or given perception, each input and seed once, and
    the frames tracked, %."""
    found = {}
    for experiment, rows in experiments:
        if experiment.get("kind") or "sweep" in experiment:
            continue
        mine = select(rows, variant=variant, case="exact", schedule=rows[0]["schedule"])
        size = experiment.get("size", "")
        stock, other = (select(mine, configuration=c) for c in ("stock", configuration))
        keys, a, b = pairs(stock, other, "ate")
        tracked = [over_repeats(r, "tracked") for r in (stock, other)]
        for key, x, y in zip(keys, a, b):
            if x > 0 and y > 0:
                found[(key[0], key[1], size)] = (x, y, tracked[0][key], tracked[1][key])
    return list(found.values())


def in_words(experiments):
    """The answer in sentences, over all pairs of the same input and seed."""
    said = []
    variants = dict.fromkeys(r["variant"] for e, rows in experiments
                             if not (e.get("kind") or "sweep" in e) for r in rows)
    for variant in variants:
        for configuration in ("KYS, literal", "KYS", "mask", "verified"):
            found = all_pairs(experiments, configuration, variant)
            if not found:
                continue
            d = difference([np.log(x) for x, *_ in found], [np.log(y) for _, y, *_ in found])
            interval = ("" if d.low is None else
                        f" (95 %: {np.exp(d.low):.2f} to {np.exp(d.high):.2f})")
            better = sum(y < 0.9 * x for x, y, *_ in found)
            worse = sum(y > 1.1 * x for x, y, *_ in found)
            verdict = {"smaller": "it helps", "larger": "it harms"}.get(d.verdict, d.verdict)
            said.append(
                f"{configuration}, {VARIANTS.get(variant, variant)}: {verdict}. ATE {np.exp(d.mean):.2f} "
                f"times that of stock{interval} over {len(found)} pairs; better by more than a tenth "
                f"in {better}, worse in {worse}. Frames tracked {mean([p[3] for p in found]):.1f} %, "
                f"stock {mean([p[2] for p in found]):.1f} %.")
    return "<ul>" + "".join(f"<li>{html.escape(s)}</li>" for s in said) + "</ul>"


def places_in_words(places):
    """Kinds of scenes by verdict."""
    at = {name: places.header.index(name) for name in ("scene", "variant", "verdict")}
    name = lambda row: row[at["scene"]] + (f" ({row[at['variant']]})" if row[at["variant"]] else "")
    words = lambda verdict: ", ".join(name(r) for r in places.rows
                                      if r[at["verdict"]] == verdict) or "nowhere"
    return (f"<p>KYS has the smaller error in: {html.escape(words('smaller'))}. The larger in: "
            f"{html.escape(words('larger'))}. Elsewhere no difference is shown, or pairs are too few.</p>")


def where(experiments):
    """Inputs on which KYS and stock differ by more than a tenth, most first."""
    found = {}
    for experiment, rows in experiments:
        if experiment.get("kind") or "sweep" in experiment:
            continue
        for name in unique(rows, "input"):
            for variant in unique(rows, "variant"):
                mine = select(rows, input=name, variant=variant, case="exact",
                              schedule=rows[0]["schedule"])
                stock, kys = (select(mine, configuration=c) for c in ("stock", "KYS"))
                _, a, b = pairs(stock, kys, "ate")
                if a and min(a + b) > 0:
                    what = {r["input"]: r.get("what", "given data") for r in mine}[name]
                    key = (what.split(",")[0], variant)
                    tracked = [mean([r.get("tracked") for r in c]) for c in (stock, kys)]
                    found.setdefault(key, {})[(name, tuple(a))] = [(x, y, *tracked)
                                                                   for x, y in zip(a, b)]
    body = []
    for (what, variant), groups in found.items():
        values = [p for g in groups.values() for p in g]
        d = difference([np.log(v[0]) for v in values], [np.log(v[1]) for v in values])
        interval = "-" if d.low is None else f"{np.exp(d.low):.3f} to {np.exp(d.high):.3f}"
        body.append([what, variant, d.pairs, *(show(mean([v[k] for v in values])) for k in (0, 1)),
                     *(show(mean([v[k] for v in values]), 1) for k in (2, 3)),
                     f"{np.exp(d.mean):.3f}", interval, d.verdict])
    return Table("where", "Where it helps: KYS and stock by kind of scene",
                 ["scene", "variant", "pairs", "stock, mean ATE, m", "KYS, mean ATE, m",
                  "stock, tracked %", "KYS, tracked %", "ratio", "95 %", "verdict"], body)


def cost_summary(results, experiments):
    for experiment, rows in experiments:
        if experiment.get("kind") != "costs":
            continue
        said, base = [], None
        for configuration in unique(rows, "configuration"):
            mine = select(rows, configuration=configuration)
            total = mean([r["timing_ms"]["total"]["mean"] for r in mine if "timing_ms" in r])
            memory = mean([r.get("peak_mb") for r in mine])
            if total is not None:
                base = base or total
                said.append(f"{configuration}: {total:.1f} ms per frame ({total - base:+.1f} ms), "
                            f"{memory:.0f} MB")
        seen = [results.done(job) for job in experiment.get("perception", {}).values()]
        for key, what in (("networks_ms", "segmentation by a network"),
                          ("classical_ms", "disparity and flow by SGBM and DIS, one core")):
            value = mean([s.get(key) for s in seen])
            if value is not None:
                said.append(f"before the run, {what}: {value:.0f} ms")
        return "; ".join(said) + ". Times hold for an idle machine only."
    return "not measured in this run"


def differences(source):
    """Headings of docs/differences.md: what differs from the paper."""
    path = os.path.join(source, "docs", "differences.md")
    try:
        with open(path, encoding="utf-8") as file:
            rows = re.findall(r"^\| \*\*(.+?)\*\* \|", file.read().replace("`", ""), re.M)
    except OSError:
        return "<p>docs/differences.md</p>"
    items = "".join(f"<li>{html.escape(r)}</li>" for r in rows)
    return f'<ul class="columns">{items}</ul><p>Each with its reason and effect: docs/differences.md.</p>'


def first_page(results, experiments):
    plan = results.plan
    statuses = [results.done(i)["status"] for i in plan["jobs"]]
    counts = {s: statuses.count(s) for s in dict.fromkeys(statuses)}
    summary, places = helps(results, experiments), where(experiments)
    given = plan["given"]
    text = ["<h1>KYS-SLAM: tables and figures of the paper, reproduced</h1>",
            f"<p>Scale: {plan['scale']}. Jobs: "
            + ", ".join(f"{n} {s}" for s, n in counts.items()) + ". Lost: fewer than half of the "
            "frames have a pose; failed: no result, with the reason in its section.</p>"]
    if given:
        text.append("<p>Given data: " + html.escape(", ".join(sorted(given))) + ".</p>")
    if any(r["origin"] != "given" for _, rows in experiments for r in rows):
        text.append('<p class="warning">Sequences that were not given were simulated. Their figures '
                    "are in tables of their own, marked as stand-ins or simulated worlds, and do not "
                    "compare with published ones.</p>")
    if plan["scale"] != "full":
        text.append('<p class="warning">Short sequences and few seeds: a look at everything, no '
                    "evidence. The full scale is the default of tools/reproduce.sh.</p>")
    text += ["<h3>Does it help, and by how much?</h3>", in_words(experiments), summary.html(),
             "<h3>Where?</h3>", places_in_words(places), places.html(),
             "<h3>What does it cost?</h3>", f"<p>{html.escape(cost_summary(results, experiments))}</p>",
             "<h3>What differs from the paper?</h3>", differences(plan["source"])]
    return "\n".join(text), [summary, places]


# --- the report ---------------------------------------------------------------------------------


def embedded(path):
    with open(path, "rb") as file:
        data = base64.b64encode(file.read()).decode()
    title = html.escape(os.path.basename(path)[:-4])
    return f'<p><img alt="{title}" src="data:image/png;base64,{data}"></p>'


def write_table(table, folder):
    write_text(os.path.join(folder, table.name + ".csv"), table.comma_separated())
    if table.name.endswith(".runs"):
        return
    write_text(os.path.join(folder, table.name + ".md"), table.markdown())
    write_text(os.path.join(folder, table.name + ".tex"), table.latex())


def failures(rows):
    """What failed and why, each reason once."""
    seen = {}
    for r in rows:
        if r["status"] in ("failed", "lost"):
            key = (r["input"], r["configuration"], r["case"], r["status"], r["reason"])
            seen[key] = seen.get(key, 0) + 1
    if not seen:
        return ""
    items = "".join(f"<li>{html.escape(', '.join(k[:3]))}: {k[3]}: {html.escape(k[4])}"
                    f"{f' ({n} runs)' if n > 1 else ''}</li>" for k, n in list(seen.items())[:40])
    more = f"<li>and {len(seen) - 40} more</li>" if len(seen) > 40 else ""
    return f"<h4>Failed or lost</h4><ul>{items}{more}</ul>"


def section(experiment, results, rows, folders):
    tables = value_tables(experiment, rows)
    if experiment.get("kind") == "costs":
        tables = cost_tables(experiment, results, rows) + tables
    elif experiment.get("kind") not in ("stall", "survey"):
        tables += paired_tables(experiment, rows)
    if experiment.get("exposure"):
        tables += exposure_tables(experiment, results)
    if experiment["name"].startswith("study_"):
        tables += best_tables(experiment, rows)
    tables += loop_tables(experiment, rows) + published_table(experiment)
    for table in [*tables, runs_table(experiment, rows)]:
        write_table(table, folders["tables"])
    shown = pictures(experiment, results, rows, folders["figures"])
    left_out = "".join(f"<li>{html.escape(k)}: {html.escape(v)}</li>"
                       for k, v in experiment["left_out"].items())
    return "\n".join([
        f'<h2 id="{experiment["name"]}">{html.escape(experiment["paper"])}: '
        f"{html.escape(experiment['title'])}</h2>",
        f"<p>{html.escape(experiment.get('about', ''))}</p>",
        f"<p>Left out:</p><ul>{left_out}</ul>" if left_out else "",
        *[t.html() for t in tables], *[embedded(p) for p in shown], failures(rows)])


def main():
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    start = time.monotonic()
    try:
        results = Results(sys.argv[1])
        folders = {n: os.path.join(results.work, n) for n in ("tables", "figures")}
        for folder in folders.values():
            os.makedirs(folder, exist_ok=True)
            for old in os.listdir(folder):
                os.unlink(os.path.join(folder, old))
        experiments = [(e, results.rows(e)) for e in results.plan["experiments"]]
        experiments = [(e, rows) for e, rows in experiments if rows]
        head, tables = first_page(results, experiments)
        for table in tables:
            write_table(table, folders["tables"])
        body = []
        for experiment, rows in experiments:
            print(f"{time.monotonic() - start:6.1f} s  {experiment['name']}", flush=True)
            body.append(section(experiment, results, rows, folders))
    except (InputError, OSError) as error:
        print(f"report.py: {error}", file=sys.stderr)
        return 2
    links = "".join(f'<a href="#{e["name"]}">{html.escape(e["paper"])}</a>' for e, _ in experiments)
    page = ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<link rel="icon" href="data:,"><title>KYS-SLAM experiments</title>'
            f"<style>{STYLE}</style></head><body>\n{head}\n<nav>{links}</nav>\n"
            + "\n".join(body) + "\n</body></html>\n")
    write_text(os.path.join(results.work, "report.html"), page)
    print(f"{os.path.join(results.work, 'report.html')}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
