# SPDX-License-Identifier: BSD-3-Clause
"""Tables as values, and how they are written: Markdown, CSV, LaTeX, HTML."""
import csv
import dataclasses
import html
import io


def show(value, digits=4):
    """A number as text; "-" for None. Large numbers need fewer digits."""
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    if isinstance(value, int):
        return str(value)
    if abs(value) >= 10:
        digits = min(digits, 2)
    elif abs(value) >= 1:
        digits = min(digits, 3)
    return f"{value:.{digits}f}"


@dataclasses.dataclass
class Table:
    """Rows of text under a header. `groups`: rows before which a line is drawn, with its text."""

    name: str  # of its files
    title: str
    header: list
    rows: list
    note: str = ""
    groups: dict = dataclasses.field(default_factory=dict)

    def markdown(self):
        line = lambda cells: "| " + " | ".join(str(c).replace("|", "\\|") for c in cells) + " |"
        text = [f"### {self.title}", "", line(self.header), line(["---"] * len(self.header))]
        for i, row in enumerate(self.rows):
            if i in self.groups:
                text.append(line([f"*{self.groups[i]}*"] + [""] * (len(self.header) - 1)))
            text.append(line(row))
        return "\n".join(text + (["", self.note] if self.note else [])) + "\n"

    def comma_separated(self):
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(self.header)
        writer.writerows(self.rows)
        return stream.getvalue()

    def latex(self):
        escape = lambda c: "".join({"&": r"\&", "%": r"\%", "_": r"\_", "#": r"\#", "$": r"\$",
                                    "^": r"\^{}", "~": r"\~{}"}.get(x, x) for x in str(c))
        line = lambda cells: " & ".join(map(escape, cells)) + r" \\"
        text = [r"\begin{table}", r"\centering", r"\begin{tabular}{l" + "r" * (len(self.header) - 1)
                + "}", r"\hline", line(self.header), r"\hline"]
        for i, row in enumerate(self.rows):
            if i in self.groups:
                text.append(r"\multicolumn{" + str(len(self.header)) + r"}{l}{\textit{"
                            + escape(self.groups[i]) + r"}} \\")
            text.append(line(row))
        text += [r"\hline", r"\end{tabular}", r"\caption{" + escape(self.title) + "}", r"\end{table}"]
        return "\n".join(text) + "\n"

    def html(self):
        cell = lambda tag, c: f"<{tag}>{html.escape(str(c))}</{tag}>"
        text = ["<table>", f"<caption>{html.escape(self.title)}</caption>", "<thead><tr>"
                + "".join(cell("th", c) for c in self.header) + "</tr></thead><tbody>"]
        for i, row in enumerate(self.rows):
            if i in self.groups:
                text.append(f'<tr class="group"><td colspan="{len(self.header)}">'
                            f"{html.escape(self.groups[i])}</td></tr>")
            text.append("<tr>" + "".join(cell("td", c) for c in row) + "</tr>")
        text.append("</tbody></table>")
        if self.note:
            text.append(f'<p class="note">{html.escape(self.note)}</p>')
        return "\n".join(text)
