# SPDX-License-Identifier: BSD-3-Clause
"""A forest plot as HTML: a row per ratio with its interval on a logarithmic axis. Text stays text, and the
plot takes the width of the page."""
import html
import math
from typing import NamedTuple

STYLE = """
.forest { margin: 1rem 0; font-size: 13px; }
.forest .row { display: grid; grid-template-columns: 9rem 1fr 12rem 13rem; column-gap: .8rem;
  align-items: center; border-bottom: 1px solid #eee; }
.forest .group { font-style: italic; background: #f4f4f4; padding: .15rem .3rem; margin-top: .4rem; }
.forest .bar { position: relative; height: 1.5rem; }
.forest .bar * { position: absolute; top: 0; bottom: 0; }
.forest .tick { width: 1px; background: #e4e4e4; } .forest .one { width: 2px; margin-left: -1px; background: #888; }
.forest .interval { top: 45%; bottom: 45%; min-width: 2px; background: #555; }
.forest .ratio { top: 32%; bottom: 32%; width: 9px; margin-left: -4px; background: #555; border-radius: 5px; }
.forest .smaller .interval, .forest .smaller .ratio { background: #1f7a4d; }
.forest .larger .interval, .forest .larger .ratio { background: #b3261e; }
.forest .axis .label { transform: translateX(-50%); background: none; color: #555; font-size: 11.5px; }
.forest .axis .label:first-child { transform: none; }
.forest .axis .label:last-child { transform: translateX(-100%); }
.forest small { color: #555; }
@media (max-width: 60rem) { .forest .row { grid-template-columns: 1fr auto; row-gap: 0; padding: .2rem 0; }
  .forest .bar { grid-column: 1 / 3; order: 3; } .forest .about { grid-column: 1 / 3; order: 4; } }
"""


class Row(NamedTuple):
    """`ratio`, `low` and `high` are None where there is no such number."""

    group: str
    label: str
    ratio: float | None
    low: float | None
    high: float | None
    verdict: str
    about: str  # pairs and what they leave out


def axis_of(rows):
    """(low, high) of the axis, powers of ten times 1, 2 or 5, with 1 between them."""
    values = [v for r in rows for v in (r.ratio, r.low, r.high) if v] + [0.5, 2]
    steps = [m * 10.0**e for e in range(-6, 7) for m in (1, 2, 5)]
    low = max((s for s in steps if s <= min(values)), default=steps[0])
    return low, min((s for s in steps if s >= max(values)), default=steps[-1])


def ticks_of(low, high):
    """The ends, 1, and powers of ten between them that are not near an end."""
    width = math.log10(high / low)
    powers = [10.0**e for e in range(math.floor(math.log10(low)) + 1, math.ceil(math.log10(high)))]
    return [low, *[p for p in powers if min(math.log10(p / low), math.log10(high / p)) > 0.08 * width], high]


def forest(rows):
    """Rows in their order, a line before every group."""
    low, high = axis_of(rows)
    at = lambda v: 100 * min(1, max(0, math.log(v / low) / math.log(high / low)))
    ticks = ticks_of(low, high)
    lines = "".join(f'<span class="{"one" if t == 1 else "tick"}" style="left:{at(t):.2f}%"></span>' for t in ticks)
    labels = "".join(f'<span class="label" style="left:{at(t):.2f}%">{t:g}</span>' for t in ticks)
    axis = f'<div class="row axis"><span></span><div class="bar">{labels}</div><span></span><span></span></div>'
    text, group = [], None
    for r in rows:
        if r.group != group:
            group = r.group
            text.append(f'<div class="group">{html.escape(group)}</div>')
        bar, number = "", "-"
        if r.ratio:
            number = f"{r.ratio:.2g}"
            if r.low:
                number += f" ({r.low:.2g} to {r.high:.2g})"
                bar = (f'<span class="interval" style="left:{at(r.low):.2f}%;'
                       f'width:{at(r.high) - at(r.low):.2f}%"></span>')
            bar += f'<span class="ratio" style="left:{at(r.ratio):.2f}%"></span>'
        kind = r.verdict if r.verdict in ("smaller", "larger") else "open"
        text.append(f'<div class="row {kind}"><span>{html.escape(r.label)}</span>'
                    f'<div class="bar">{lines}{bar}</div><span>{number}</span>'
                    f'<span class="about">{html.escape(r.verdict)} <small>{html.escape(r.about)}</small></span></div>')
    return f'<div class="forest">{axis}{"".join(text)}{axis}</div>'
