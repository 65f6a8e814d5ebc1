# SPDX-License-Identifier: BSD-3-Clause
"""The first page of the report: what the experiments say, and what differs from the paper."""
import html
import os
import re

import numpy as np

from experiment_tables import WITHOUT, paired_rows
from paired import difference, mean
from results import ORIGINS, over_repeats, pairs, select, unique
from tables import Table, show


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
                                     variant, configuration, row[0], row[1], row[4], row[5], row[6], row[9]])
    return Table("summary", "ATE over that of stock, exact or given perception",
                 ["experiment", "origin", "variant", "configuration", "pairs", WITHOUT, "ratio",
                  "95 %", "Wilcoxon p", "verdict"], body,
                 "Below 1: better than stock. A verdict needs 6 pairs, an interval without 1 and Wilcoxon p "
                 "below 0.05; pairs of few inputs say little.")


VARIANTS = {"votes": "with vote counting (ORB-SLAM's, the paper's baseline)",
            "balanced": "with balanced consensus (the default here)", "": "with the default settings"}


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


def sentence(label, found):
    """What `all_pairs` found, in words."""
    without, without_stock = (sum(p[k] for p in found) for k in (4, 5))
    lost = f"{without} without result (stock {without_stock})"
    end = (f" Frames tracked {show(mean([p[3] for p in found]), 1)} %, "
           f"stock {show(mean([p[2] for p in found]), 1)} %.")
    both = [(x, y) for x, y, *_ in found if x is not None]
    if not both:
        return f"{label}: no pairs, {lost}.{end}"
    d = difference([np.log(x) for x, _ in both], [np.log(y) for _, y in both])
    interval = "" if d.low is None else f" (95 %: {np.exp(d.low):.2f} to {np.exp(d.high):.2f})"
    better, worse = sum(y < 0.9 * x for x, y in both), sum(y > 1.1 * x for x, y in both)
    verdict = {"smaller": "it helps", "larger": "it harms"}.get(d.verdict, d.verdict)
    return (f"{label}: {verdict}. ATE {np.exp(d.mean):.2f} times that of stock{interval} over {len(both)} "
            f"pairs, {lost}; better by more than a tenth in {better}, worse in {worse}.{end}")


def in_words(experiments):
    """The answer in sentences, over all pairs of the same input and seed; origins are never mixed."""
    said = []
    kept = [r for e, rows in experiments if not (e.get("kind") or "sweep" in e) for r in rows]
    for origin, variant in dict.fromkeys((r["origin"], r["variant"]) for r in kept):
        for configuration in ("KYS, literal", "KYS", "mask", "verified"):
            found = all_pairs(experiments, configuration, variant, origin)
            if found:
                said.append(sentence(f"{configuration}, {ORIGINS[origin]}, "
                                     f"{VARIANTS.get(variant, variant)}", found))
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
                    "are in tables of their own, marked as substitutes or simulated worlds, and do not "
                    "compare with published ones.</p>")
    if plan["scale"] != "full":
        text.append('<p class="warning">Short sequences and few seeds: an overview of every table, no '
                    "evidence. The full scale is the default of tools/reproduce.sh.</p>")
    text += ["<h3>Does it help, and by how much?</h3>", in_words(experiments), summary.html(),
             "<h3>Where?</h3>", places_in_words(places), places.html(),
             "<h3>What does it cost?</h3>", f"<p>{html.escape(cost_summary(results, experiments))}</p>",
             "<h3>What differs from the paper?</h3>", differences(plan["source"])]
    return "\n".join(text), [summary, places]
