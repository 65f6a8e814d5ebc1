#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Tables, figures and the report of a work folder (plan.py), complete or not.

    report.py WORK

Writes WORK/report.html, one file with everything in it; the tables in WORK/tables as CSV, Markdown
and LaTeX, with every run as a row of NAME.runs.csv; the figures in WORK/figures as PNG.
"""
import base64
import html
import os
import sys
import time

import forest
from experiment_pictures import pictures
from experiment_tables import (best_tables, cost_tables, exposure_tables, loop_tables,
                               paired_tables, published_table, runs_table, value_tables)
from first_page import first_page
from results import Results
from runs import InputError, remove, write_text

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 92rem; margin: 2rem auto; padding: 0 1rem;
  color: #1b1b1b; }
h1, h2 { line-height: 1.2; } h2 { margin-top: 3rem; border-top: 2px solid #ddd; padding-top: 1rem; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 12.5px; display: block;
  overflow-x: auto; }
caption { text-align: left; font-weight: 600; padding: .3rem 0; }
th, td { padding: .2rem .4rem; text-align: right; border-bottom: 1px solid #eee; vertical-align: top; }
th:first-child, td:first-child { text-align: left; } thead th { border-bottom: 2px solid #888; }
tr.group td { text-align: left; font-style: italic; background: #f4f4f4; }
p.note { font-size: 12.5px; color: #555; margin-top: -.5rem; } img { max-width: 100%; }
.warning { background: #fff4d6; padding: .4rem .8rem; }
nav a { margin-right: 1rem; } ul.columns { columns: 16rem; font-size: 13px; } li { overflow-wrap: anywhere; }
"""


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


SHOWN = 6  # runs named per reason


def failures(rows):
    """Why runs failed or were lost: each reason once, with the runs that it concerns."""
    seen = {}
    for r in rows:
        if r["status"] in ("failed", "lost"):
            run = f"{r['input']}, {r['configuration']}" + (f", {r['case']}" if r["case"] else "")
            seen.setdefault((r["status"], r["reason"]), []).append(run)
    items = []
    for (status, reason), runs in sorted(seen.items(), key=lambda item: -len(item[1])):
        names = list(dict.fromkeys(runs))
        more = f"; and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        items.append(f"<li>{len(runs)} {status}: {html.escape(reason)}<br><small>"
                     f"{html.escape('; '.join(names[:SHOWN]))}{more}</small></li>")
    return f"<h4>Failed or lost</h4><ul>{''.join(items)}</ul>" if items else ""


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
        kept = {n: os.path.join(results.work, n) for n in ("tables", "figures")}
        folders = {n: path + ".new" for n, path in kept.items()}
        for folder in folders.values():
            remove(folder)
            os.makedirs(folder)
        experiments = [(e, results.rows(e)) for e in results.plan["experiments"]]
        experiments = [(e, rows) for e, rows in experiments if rows]
        head, tables = first_page(results, experiments)
        for table in tables:
            write_table(table, folders["tables"])
        body = []
        for experiment, rows in experiments:
            print(f"{time.monotonic() - start:6.1f} s  {experiment['name']}", flush=True)
            body.append(section(experiment, results, rows, folders))
        for name, path in kept.items():  # all is written: what was there before goes
            remove(path)
            os.replace(folders[name], path)
    except (InputError, OSError) as error:
        print(f"report.py: {error}", file=sys.stderr)
        return 2
    links = "".join(f'<a href="#{e["name"]}">{html.escape(e["paper"])}</a>' for e, _ in experiments)
    page = ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<link rel="icon" href="data:,"><title>KYS-SLAM experiments</title>'
            f"<style>{STYLE}{forest.STYLE}</style></head><body>\n{head}\n<nav>{links}</nav>\n"
            + "\n".join(body) + "\n</body></html>\n")
    write_text(os.path.join(results.work, "report.html"), page)
    print(f"{os.path.join(results.work, 'report.html')}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
