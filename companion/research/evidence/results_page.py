"""A campaign's results as one self-contained HTML page; a click on a column's head sorts its table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from companion.plain_text import in_page
from companion.research.evidence.evidence_tables import Cell, ResultTable
from companion.ui.reports.report import STYLE_SHEET, html_page

STYLE = (
    STYLE_SHEET
    + """
main { max-width: 1280px; }
h3 { font-size: 1rem; margin: 1.6rem 0 .4rem; }
p.note { color: var(--muted); font-size: .88rem; margin: .35rem 0 0; max-width: 75ch; }
nav { margin: 1rem 0 0; font-size: .93rem; }
nav a { margin-right: 1.2rem; color: #0a4fa3; }
th button { all: unset; cursor: pointer; font-weight: 600; }
th button:focus-visible { outline: 2px solid #0a4fa3; }
th[aria-sort=ascending] button::after { content: " \\25B2"; }
th[aria-sort=descending] button::after { content: " \\25BC"; }
td { white-space: nowrap; }
thead th { vertical-align: bottom; }
th small { display: block; font-weight: 400; color: var(--muted); white-space: normal; line-height: 1.25;
           min-width: 6.5rem; }
td.value { text-align: right; }
th.value { text-align: right; }
tr.reproduced td.verdict { color: #0d7a3f; font-weight: 600; }
tr.not-reproduced td.verdict { color: #c8102e; font-weight: 600; }
"""
)
WORDS_MAX = 44  # Most characters of a column's head.
SCRIPT = """
for (const button of document.querySelectorAll("th button")) {
  button.addEventListener("click", () => {
    const head = button.parentElement, row = head.parentElement, table = head.closest("table");
    const column = [...row.children].indexOf(head);
    const falls = head.getAttribute("aria-sort") === "ascending";
    for (const other of row.children) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", falls ? "descending" : "ascending");
    const value = (line) => line.children[column].dataset.value;
    const order = (a, b) => {
      const [x, y] = [Number(a), Number(b)];
      if (a === "" || b === "") return (a === "") - (b === "");
      const by = Number.isNaN(x) || Number.isNaN(y) ? a.localeCompare(b) : x - y;
      return falls ? -by : by;
    };
    const body = table.tBodies[0];
    body.append(...[...body.rows].sort((a, b) => order(value(a), value(b))));
  });
}
"""


@dataclass(frozen=True, slots=True)
class Part:
    """A part of the page: its heading, introduction, tables, and a drawing as SVG."""

    heading: str
    lead: str
    tables: Sequence[ResultTable]
    drawing: str = ""
    caption: str = ""


def results_page(title: str, leads: Sequence[str], parts: Sequence[Part]) -> str:
    """Page of HTML.

    Parameters
    ----------
    title : str
        Title of the page.
    leads : sequence of str
        Lines below it.
    parts : sequence of Part
        The parts, in order.
    """
    links = "\n".join(f'<a href="#part-{n}">{in_page(part.heading)}</a>' for n, part in enumerate(parts))
    paragraphs = "\n".join(f'<p class="lead">{in_page(lead)}</p>' for lead in leads)
    bodies = "\n".join(_part(n, part) for n, part in enumerate(parts))
    head = f"{paragraphs}\n<nav>\n{links}\n</nav>"
    return html_page(title, head, bodies, STYLE, after=f"<script>{SCRIPT}</script>\n")


def _part(number: int, part: Part) -> str:
    figure = ""
    if part.drawing:
        caption = f"<figcaption>{in_page(part.caption)}</figcaption>"
        figure = f"<figure><div>{part.drawing}</div>{caption}</figure>"
    lead = f'<p class="lead">{in_page(part.lead)}</p>' if part.lead else ""
    tables = "\n".join(map(_table, part.tables))
    return f'<h2 id="part-{number}">{in_page(part.heading)}</h2>\n{lead}\n{figure}\n{tables}'


def _table(table: ResultTable) -> str:
    heads = "".join(
        f'<th scope="col"{_kind(table, n)} title="{in_page(words)}">'
        f'<button type="button">{in_page(name)}</button>{_below(words)}</th>'
        for n, (name, words) in enumerate(table.columns)
    )
    rows = "\n".join(_row(table, row) for row in table.rows)
    note = f'<p class="note">{in_page(table.note)}</p>' if table.note else ""
    return f"""<h3>{in_page(table.title)}</h3>
<div class="scroll" tabindex="0" role="region" aria-label="{in_page(table.title)}">
<table>
<thead><tr>{heads}</tr></thead>
<tbody>
{rows}
</tbody>
</table>
</div>
{note}"""


def _below(words: str) -> str:
    """Return the meaning of a head, if it is short enough to be shown there."""
    return f"<small>{in_page(words)}</small>" if 0 < len(words) <= WORDS_MAX else ""


def _row(table: ResultTable, row: Sequence[Cell]) -> str:
    names = [name for name, _ in table.columns]
    classes = ""
    if "verdict" in names:
        classes = f' class="{in_page(row[names.index("verdict")].text.replace(" ", "-"))}"'
    cells = "".join(
        f'<td{_kind(table, n)} data-value="{_sorted_by(cell)}" title="{in_page(cell.more)}">'
        f"{in_page(cell.text)}</td>"
        for n, cell in enumerate(row)
    )
    return f"<tr{classes}>{cells}</tr>"


def _kind(table: ResultTable, column: int) -> str:
    """Return the CSS class of a column: numbers are aligned to the right, and verdicts are coloured."""
    if table.columns[column][0] == "verdict":
        return ' class="verdict"'
    return ' class="value"' if table.is_numeric(column) else ""


def _sorted_by(cell: Cell) -> str:
    if isinstance(cell.value, str):
        return in_page(cell.value)
    return repr(cell.value) if math.isfinite(cell.value) else ""
