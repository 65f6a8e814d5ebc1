# SPDX-License-Identifier: BSD-3-Clause
"""The first page of the report: what the experiments say, and what differs from the paper."""
import html
import os
import re

import numpy as np

import forest
from experiment_tables import WITHOUT, paired_rows
from paired import RULE, difference, mean
from results import ORIGINS, over_repeats, pairs, select, unique
from tables import Table, show

CONFIGURATIONS = ("KYS, literal", "KYS", "mask", "verified")


def helps(results, experiments):
    """Sentences: KYS against stock on every input group, by origin and variant."""
    body = []
    for experiment, rows in experiments:
        if experiment.get("kind") or "sweep" in experiment:
            continue
        for configuration in CONFIGURATIONS:
            for origin in unique(rows, "origin"):
                for variant in unique(rows, "variant"):
                    mine = select(rows, origin=origin, variant=variant, case="exact",
                                  schedule=rows[0]["schedule"])
                    row = paired_rows([], select(mine, configuration="stock"),
                                      select(mine, configuration=configuration), "ate")
                    if row:
                        body.append([f"{experiment['title']} ({experiment['paper']})", ORIGINS[origin],
                                     variant, configuration, row[0], row[1], row[4], row[5], row[6], row[9]])
    return Table("summary", "ATE over that of stock, exact or given perception",
                 ["experiment", "origin", "variant", "configuration", "pairs", WITHOUT, "ratio",
                  "95 %", "Wilcoxon p", "verdict"], body,
                 "Below 1: better than stock. " + RULE)


def all_pairs(experiments, configuration, variant, origin):
    """ATE of stock and of a configuration, exact or given perception, each input and seed once (None:
    without a result), and the frames tracked, %."""
    values = {}
    for experiment, rows in experiments:
        if experiment.get("kind") or "sweep" in experiment:
            continue
        mine = select(rows, variant=variant, case="exact", schedule=rows[0]["schedule"], origin=origin)
        size = experiment.get("size", "")
        stock, other = (select(mine, configuration=c) for c in ("stock", configuration))
        found = pairs(stock, other, "ate")
        ate = [dict(zip(found.keys, side)) for side in (found.baseline, found.values)]
        tracked = [over_repeats(r, "tracked") for r in (stock, other)]
        for key in dict.fromkeys([*found.keys, *found.lost, *found.lost_baseline]):
            x, y = (side.get(key) for side in ate)
            if x is None or (x > 0 and y > 0):
                values[(key[0], key[1], size)] = (
                    x, y, tracked[0].get(key), tracked[1].get(key), key in found.lost,
                    key in found.lost_baseline)
    return list(values.values())


def about(found):
    """Pairs of `all_pairs`, what they leave out, and the frames tracked, in words."""
    both = sum(p[0] is not None for p in found)
    without, without_stock = (sum(p[k] for p in found) for k in (4, 5))
    lost = f", {without} without result (stock {without_stock})" if without or without_stock else ""
    tracked = [show(mean([p[k] for p in found]), 1) for k in (3, 2)]
    frames = "" if tracked == ["100.0", "100.0"] else f"; tracked {tracked[0]} % (stock {tracked[1]} %)"
    return f"{both} pairs{lost}{frames}"


def pooled(experiments):
    """Rows of the forest plot: ATE over that of stock, over all pairs of the same input and seed; origins and
    variants are never mixed."""
    rows = []
    kept = [r for e, runs in experiments if not (e.get("kind") or "sweep" in e) for r in runs]
    for origin, variant in dict.fromkeys((r["origin"], r["variant"]) for r in kept):
        for configuration in CONFIGURATIONS:
            found = all_pairs(experiments, configuration, variant, origin)
            both = [p[:2] for p in found if p[0] is not None]
            if found:
                d = difference([np.log(x) for x, _ in both], [np.log(y) for _, y in both])
                power = lambda v: None if v is None else float(np.exp(v))
                group = ", ".join(filter(None, (ORIGINS[origin], variant and f"pose by {variant}")))
                rows.append(forest.Row(group, configuration, power(d.mean), power(d.low), power(d.high),
                                       d.verdict, about(found)))
    return rows


def accuracy(experiments):
    """Median ATE by origin, exact or given perception, the default pose where there is a choice."""
    said = []
    kept = [r for e, rows in experiments if not (e.get("kind") or "sweep" in e) for r in rows
            if r["case"] == "exact" and r["schedule"] == rows[0]["schedule"] and r.get("ate") is not None]
    for origin in unique(kept, "origin"):
        mine = select(kept, origin=origin)
        mine = [r for r in mine if r["variant"] in ("", "image area")] or mine
        values = {c: [r["ate"] for r in select(mine, configuration=c)]
                  for c in ("stock", *reversed(CONFIGURATIONS)) if select(mine, configuration=c)}
        medians = [f"{c} {show(float(np.median(v)), 3)} m" for c, v in list(values.items())[:2]]
        if medians:
            said.append(f"{ORIGINS[origin]} {', '.join(medians)} over {len(next(iter(values.values())))} runs")
    return f"Median ATE with exact or given perception: {'; '.join(said)}." if said else "No run has a result."


def compared(given):
    return (("Given data: " + ", ".join(sorted(given)) + "; published figures stand below ours in their tables."
             if given else "No data was given: every sequence is simulated, and published figures, which are of "
             "complete real recordings, stand in tables of their own: sizes do not compare."))


def helps_in_words(rows, places):
    count = lambda verdict: sum(r.verdict == verdict for r in rows)
    at = {name: places.header.index(name) for name in ("scene", "variant", "verdict")}
    name = lambda row: row[at["scene"]] + (f" ({row[at['variant']]})" if row[at["variant"]] else "")
    words = lambda verdict: ", ".join(name(r) for r in places.rows if r[at["verdict"]] == verdict) or "nowhere"
    return (f"Verdicts of the {len(rows)} ratios above: smaller {count('smaller')}, larger {count('larger')}, no "
            f"difference shown {count('no difference shown')}, too wide to say {count('too wide to say')}; "
            f"KYS has the smaller error in: {words('smaller')}; the larger in: {words('larger')}.")


def reproducible(statuses, experiments):
    """Jobs by status; the spread of repeats of one run."""
    counts = ", ".join(f"{statuses.count(s)} {s}" for s in dict.fromkeys(statuses))
    groups = {}
    for _, rows in experiments:
        for r in rows:
            if r.get("ate"):
                key = tuple(r[k] for k in ("input", "seed", "configuration", "variant", "case", "schedule"))
                groups.setdefault(key, {})[r["repeat"]] = r["ate"]
    spread = [max(g.values()) / min(g.values()) for g in groups.values() if len(g) > 1]
    return (f"Of {len(statuses)} jobs {counts} (lost: fewer than half of the frames have a pose); runs of the "
            "schedules sequential and pipelined give the same bytes every time, "
            + (f"repeats at the camera's pace differ by a factor of {show(float(np.median(spread)), 2)} (median), "
               f"at most {show(max(spread), 2)}." if spread else "and this report has no repeats of others."))


def where(experiments):
    """KYS and stock by kind of scene and variant, over pairs of the same input and seed."""
    found = {}
    for experiment, rows in experiments:
        if experiment.get("kind") or "sweep" in experiment:
            continue
        for name in unique(rows, "input"):
            for variant in unique(rows, "variant"):
                mine = select(rows, input=name, variant=variant, case="exact",
                              schedule=rows[0]["schedule"])
                stock, kys = (select(mine, configuration=c) for c in ("stock", "KYS"))
                both = pairs(stock, kys, "ate")
                _, a, b, *lost = both
                if any(both) and min(a + b, default=1) > 0:
                    what = {r["input"]: r.get("what", "given data") for r in mine}[name]
                    key = (what.split(",")[0], variant)
                    tracked = [mean([r.get("tracked") for r in c]) for c in (stock, kys)]
                    found.setdefault(key, {})[(name, tuple(a))] = (
                        [(x, y) for x, y in zip(a, b)], tracked, list(map(len, lost)))
    body = []
    for (what, variant), groups in found.items():
        values = [p for g, _, _ in groups.values() for p in g]
        tracked = [mean([t[k] for _, t, _ in groups.values()]) for k in (0, 1)]
        lost = [sum(n[k] for _, _, n in groups.values()) for k in (0, 1)]
        d = difference([np.log(v[0]) for v in values], [np.log(v[1]) for v in values])
        interval = "-" if d.low is None else f"{np.exp(d.low):.3f} to {np.exp(d.high):.3f}"
        body.append([what, variant, d.pairs, f"{lost[0]} ({lost[1]})",
                     *(show(mean([v[k] for v in values])) for k in (0, 1)),
                     *(show(v, 1) for v in tracked),
                     show(None if d.mean is None else float(np.exp(d.mean)), 3), interval, d.verdict])
    return Table("where", "Where it helps: KYS and stock by kind of scene",
                 ["scene", "variant", "pairs", WITHOUT, "stock, mean ATE, m", "KYS, mean ATE, m",
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
        for key, what in (("segmentation_ms", "segmentation by a network"),
                          ("stereo_network_ms", "disparity by a network"),
                          ("flow_network_ms", "flow by a network"),
                          ("classical_ms", "disparity and flow by SGBM and DIS, one core")):
            value = mean([s.get(key) for s in seen])
            if value is not None:
                said.append(f"before the run, {what}: {value:.0f} ms")
        return "; ".join(said) + " (times hold for an idle machine only)."
    return "Not measured in this run."


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


def by_experiment(summary):
    """The rows of `helps` as rows of a forest plot."""
    at = {name: summary.header.index(name) for name in summary.header}
    number = lambda text: None if text == "-" else float(text)
    rows = []
    for r in summary.rows:
        ends = r[at["95 %"]].split(" to ")
        low, high = map(number, ends) if len(ends) == 2 else (None, None)
        group = ", ".join(filter(None, (r[at["experiment"]], r[at["origin"]], r[at["variant"]])))
        rows.append(forest.Row(group, r[at["configuration"]], number(r[at["ratio"]]), low, high,
                               r[at["verdict"]], f"{r[at['pairs']]} pairs"))
    return rows


def first_page(results, experiments):
    plan = results.plan
    statuses = [results.done(i)["status"] for i in plan["jobs"]]
    summary, places, rows = helps(results, experiments), where(experiments), pooled(experiments)
    answers = [("How accurate is it?", accuracy(experiments)), ("Compared with whom?", compared(plan["given"])),
               ("Do priors help, and when?", helps_in_words(rows, places)),
               ("What does it cost?", cost_summary(results, experiments)),
               ("Is it reproducible?", reproducible(statuses, experiments))]
    text = ["<h1>KYS-SLAM: tables and figures of the paper, reproduced</h1>",
            "<p>Absolute trajectory error (ATE) over that of the same program without priors (stock), exact or "
            "given perception: left of the line is better. Geometric mean over pairs of the same input and seed "
            "with its 95 % interval.</p>",
            forest.forest(rows), f'<p class="note">{html.escape(RULE)}</p>',
            "<ol>" + "".join(f"<li><b>{q}</b> {html.escape(a)}</li>" for q, a in answers) + "</ol>"]
    origins = {r["origin"] for _, rows in experiments for r in rows}
    if "partial" in origins:
        text.append('<p class="warning">Of some sequences only a part ran, as their names say. Their figures '
                    "are in tables of their own, and do not compare with published ones of the whole.</p>")
    if origins - {"given", "partial"}:
        text.append('<p class="warning">Sequences that were not given were simulated. Their figures '
                    "are in tables of their own, marked as substitutes or simulated worlds, and do not "
                    "compare with published ones.</p>")
    if plan["scale"] != "full":
        text.append('<p class="warning">Short sequences and few seeds: an overview of every table, no '
                    "evidence. The full scale is the default of tools/reproduce.sh.</p>")
    text += ["<h3>By experiment</h3>", forest.forest(by_experiment(summary)),
             "<details><summary>The same as a table</summary>", summary.html(), "</details>",
             "<h3>By kind of scene</h3>", places.html(),
             "<h3>What differs from the paper?</h3>", differences(plan["source"])]
    return "\n".join(text), [summary, places]
