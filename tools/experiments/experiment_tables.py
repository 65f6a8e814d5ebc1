# SPDX-License-Identifier: BSD-3-Clause
"""Tables of one experiment."""
import itertools

import numpy as np

from paired import deviation, difference, mean
from results import METRICS, ORIGINS, over_repeats, pairs, published, select, unique
from tables import Table, show

RUN_COLUMNS = ["origin", "input", "what", "seed", "configuration", "variant", "case", "schedule",
               "repeat", "status", "reason", "ate", "rpe_m", "rpe_deg", "tracked", "keyframes", "loops",
               "loops_true", "revisits", "revisits_joined", "wall_s", "peak_mb", "survival_8",
               "survival_20", "job"]


def cell(rows, metric):
    """Mean over seeds, its deviation, and what went wrong."""
    failed = [r for r in rows if r["status"] in ("failed", "missing")]
    values = [v for v in over_repeats(rows, metric).values() if v is not None]
    text = show(mean(values)) if values else ""
    if len(values) > 1:
        text += f" ± {show(deviation(values))}"
    tracked = mean([r.get("tracked") for r in rows if r not in failed])
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
    found = pairs(base, mine, metric)
    reductions = [100 * (x - y) / x for x, y in zip(found.baseline, found.values) if x > 0]
    text = show(mean(reductions), 1) if reductions else "-"
    return f"{text}; {len(found.lost)} without result" if found.lost else text


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
    substitutes = {r["input"]: r["what"] for r in rows if r["origin"] == "substitute"}
    text += "; frames tracked in brackets when not all."
    if any(r["origin"] == "partial" for r in rows):
        text += " Parts of sequences, not to be compared with published figures of the whole."
    if substitutes:
        text += " Substitutes, not to be compared with published figures: " + "; ".join(
            f"{k} = {v.removeprefix('substitute: ')}" for k, v in substitutes.items()) + "."
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
    """One row of the table of paired differences; None when nothing was run under both."""
    found = pairs(baseline_rows, rows, metric, ignore)
    keys, a, b = found[:3]
    if not (keys or found.lost or found.lost_baseline):
        return None
    tracked = show(mean([r.get("tracked") for r in rows]), 1)
    if not keys:
        return label + [0, found.without_result, *["-"] * 6, tracked, "too wide to say"]
    d = difference(a, b)  # of metres; the ratio, its interval, test and verdict are of logarithms
    good = [(x, y) for x, y in zip(a, b) if x > 0 and y > 0]
    ratio = difference([np.log(x) for x, _ in good], [np.log(y) for _, y in good])
    worst = max(range(len(keys)), key=lambda i: b[i] - a[i])
    interval = lambda e, f: show_interval(e, f, lambda v: show(v, 4))
    power = lambda v: None if v is None else float(np.exp(v))
    return label + [
        d.pairs, found.without_result, show(d.mean), interval(d.low, d.high), show(power(ratio.mean), 3),
        interval(power(ratio.low), power(ratio.high)), show_p(ratio.wilcoxon_p),
        f"{show(b[worst] - a[worst])} ({keys[worst][0]}, seed {keys[worst][1]})",
        tracked, ratio.verdict]


def show_interval(low, high, form):
    return "-" if low is None else f"{form(low)} to {form(high)}"


def show_p(p):
    return "< 0.001" if p is not None and p < 0.001 else show(p, 3)


WITHOUT = "without result (other's)"
PAIRED_HEADER = ["pairs", WITHOUT, "mean difference, m", "95 %", "ratio", "95 %", "Wilcoxon p", "worst",
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


def best_row(mine):
    """`verified` against the best of the others in a cell: means over the seeds of which both have a
    result. None: the cell has no such row, or no results."""
    own = select(mine, configuration="verified")
    tracked = show(mean([r.get("tracked") for r in own]), 1)
    found = {c: pairs(select(mine, configuration=c), own, "ate")
             for c in unique(mine, "configuration") if c != "verified"}
    excess = {c: mean(p.values) - 1.1 * mean(p.baseline) for c, p in found.items() if p.keys}
    if not excess:
        lost = [c for c, p in found.items() if p.lost]
        return lost and ["-", lost[0], "-", "NO", tracked, found[lost[0]].without_result]
    best = max(excess, key=excess.get)  # of the same seeds, the one with the least mean
    p = found[best]
    within = excess[best] <= 0.003 and not p.lost
    return [show(mean(p.values)), best, show(mean(p.baseline)), "yes" if within else "NO", tracked,
            p.without_result]


def best_tables(experiment, rows):
    """Of a study: where `verified` stands against the best of the others in every cell."""
    if "verified" not in unique(rows, "configuration"):
        return []
    body = []
    cells = dict.fromkeys((r["input"], r["variant"], r["case"]) for r in rows)
    for name, variant, case in cells:
        mine = select(rows, input=name, variant=variant, case=case)
        row = best_row(mine)
        if row:
            body.append([name, variant, case, *row])
    return [Table(f"{experiment['name']}-verified",
                  "verified against the best other configuration of the same cell: "
                  "at most 1.1 times plus 3 mm", ["input", "variant", "case", "verified", "best other",
                                                  "its ATE, m", "within", "tracked %", WITHOUT], body,
                  "Means over the inputs and seeds of which both have a result."),
            *([] if experiment.get("kind") else [wrong_prior_table(experiment, rows),
                                                 far_table(experiment, rows)])]


def without_empty(header, body):
    """The columns in which any row has something: a study of one variant needs no column for it."""
    kept = [k for k in range(len(header)) if any(row[k] != "" for row in body)]
    return [header[k] for k in kept], [[row[k] for k in kept] for row in body]


FAR = 1.0  # m, ATE: a trajectory that is of no use


def far_table(experiment, rows):
    """Runs of a study that are far off, by input, variant and configuration, over cases and seeds."""
    body = []
    for name, variant, configuration in dict.fromkeys(
            (r["input"], r["variant"], r["configuration"]) for r in rows):
        mine = select(rows, input=name, variant=variant, configuration=configuration)
        errors = [r["ate"] for r in mine if r.get("ate") is not None]
        body.append([name, variant, configuration, len(mine), sum(e > FAR for e in errors),
                     len(mine) - len(errors),
                     *(show(float(f(errors)) if errors else None) for f in (np.median, np.max)),
                     show(mean([r.get("tracked") for r in mine]), 1)])
    header, body = without_empty(
        ["input", "variant", "configuration", "runs", f"more than {FAR:g} m off", "without result",
         "median ATE, m", "largest ATE, m", "tracked %"], body)
    return Table(f"{experiment['name']}-far", f"Runs with an ATE of more than {FAR:g} m", header, body)


def ratio_row(mine, other, own):
    """ATE of `own` over that of `other` in these runs: pairs, ratio ...; None without any. A pair is
    an input and seed; of several cases the mean of the logarithms counts once."""
    rows = {c: select(mine, configuration=c) for c in (other, own)}
    logs = {}
    found = pairs(rows[other], rows[own], "ate")
    for key, a, b in zip(*found[:3]):
        if a > 0 and b > 0:
            logs.setdefault(key[:2], []).append(np.log(b / a))
    end = [*[show(mean([r.get("tracked") for r in rows[c]]), 1) for c in (own, other)],
           found.without_result]
    if not logs:
        lost = found.lost or found.lost_baseline
        return [0, "-", "-", "-", "too wide to say", *end] if lost else None
    values = [float(np.mean(v)) for v in logs.values()]
    d = difference(np.zeros(len(values)), values)
    form = lambda v: f"{np.exp(v):.2g}"
    return [d.pairs, form(d.mean), show_interval(d.low, d.high, form), show_p(d.wilcoxon_p), d.verdict, *end]


def wrong_prior_table(experiment, rows):
    """ATE of `verified` over that of each other configuration, with exact and with wrong priors."""
    own = "verified"
    cases = {"exact": ["exact"], "wrong": [c for c in unique(rows, "case") if c != "exact"]}
    others = [c for c in unique(rows, "configuration") if c != own]
    body = []
    inputs = unique(rows, "input")
    for variant, name, priors in itertools.product(
            unique(rows, "variant"), ["", *inputs] if len(inputs) > 1 else inputs, cases):
        mine = [r for r in rows if r["variant"] == variant and r["case"] in cases[priors]
                and name in ("", r["input"])]
        for other in others:
            row = ratio_row(mine, other, own)
            if row:
                body.append([name or "all", variant, priors, other, *row])
    header, body = without_empty(
        ["input", "variant", "priors", "other", "pairs", "ratio", "95 %", "Wilcoxon p", "verdict",
         "verified tracked %", "other tracked %", WITHOUT], body)
    return Table(f"{experiment['name']}-exact-wrong",
                 "ATE of verified over that of the others, exact and wrong priors", header, body,
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
        before = [seen.get(key) if fusion is not None else None
                  for key in ("segmentation_ms", "stereo_network_ms", "flow_network_ms", "classical_ms")]
        body.append([r["input"], ORIGINS[r["origin"]], r["configuration"]]
                    + [show(timing.get(s, {}).get("mean"), 2) for s in stages]
                    + [show(ms, 0) for ms in before]
                    + [show(fusion, 2), show(r.get("peak_mb"), 0)])
    return [Table(f"{experiment['name']}-stages", "Time per frame, mean, ms, and memory",
                  ["input", "origin", "configuration", *stages, "segmentation (network)",
                   "stereo (network)", "flow (network)", "SGBM + DIS", "fusion (build_priors)",
                   "peak memory, MB"], body,
                  "total: the tracking path of a frame, reading priors included. Beside it, before the "
                  "run, on one core: networks where make_priors measured them (given data), disparity "
                  "and flow of both cameras by SGBM and DIS, fusion. The paper gives 1696 ms for its "
                  "networks.")]


def loop_tables(experiment, rows):
    """Loops closed and true, revisits and those connected in the map, where any revisit exists."""
    mine = [r for r in rows if r.get("revisits")]
    if not mine:
        return []
    body = []
    for key in dict.fromkeys((r["origin"], r["configuration"], r["variant"]) for r in mine):
        some = [r for r in mine if (r["origin"], r["configuration"], r["variant"]) == key]
        total = lambda k: sum(r[k] for r in some)
        body.append([ORIGINS[key[0]], key[1], key[2], len(some), total("loops_closed"),
                     total("loops_true"), total("revisits"), total("revisits_joined")])
    return [Table(f"{experiment['name']}-loops", "Loops and revisits, sums over runs with revisits",
                  ["origin", "configuration", "variant", "runs", "loops closed", "of these true",
                   "revisits", "connected in the map"], body)]


def runs_table(experiment, rows):
    digits = lambda v: f"{v:.6g}" if isinstance(v, float) else "" if v is None else str(v)
    return Table(experiment["name"] + ".runs", experiment["title"], RUN_COLUMNS,
                 [[digits(r.get(k)) for k in RUN_COLUMNS] for r in rows])
