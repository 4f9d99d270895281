"""Results as one page that needs nothing else: no network, no other file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path

from gcl_core.evaluation.cases import Case
from gcl_core.evaluation.tables import Table

HERE = Path(__file__).parent
# Nothing may be loaded from anywhere; dots of plots are pictures within the page.
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"


@dataclass(frozen=True)
class Drawing:
    """A plot: caption and SVG."""

    caption: str
    svg: str


def page(
    title: str,
    facts: dict[str, str],
    parts: Sequence[Table | Drawing | str],
    cases: Sequence[Case],
    published: Sequence[Table],
) -> str:
    """Write the page.

    Args:
        title: at the top.
        facts: what was measured, where and when.
        parts: from top to bottom; a text is a heading.
        cases: shown in 3-D.
        published: tables of the paper, marked as such.
    """
    listed = ''.join(f'<dt>{escape(k)}</dt><dd>{escape(v)}</dd>' for k, v in facts.items())
    body = [f'<h1>{escape(title)}</h1><dl>{listed}</dl>', *map(_part, parts)]
    if published:
        tables = ''.join(map(_table, published))
        body.append(f'<h2>Published figures</h2><div class="published">{tables}</div>')
    if cases:
        body.append('<h2>The worst cases</h2><p class="note">Blue: target. Orange: source. ')
        body.append('Drag to turn, wheel to zoom.</p><div class="cases">')
        body += [*map(_case, cases), '</div>']
    return (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        f'<title>{escape(title)}</title><style>{(HERE / "style.css").read_text()}</style></head>'
        f'<body>{"".join(body)}<script>{(HERE / "viewer.js").read_text()}</script></body></html>\n'
    )


def _part(part: Table | Drawing | str) -> str:
    if isinstance(part, str):
        return f'<h2>{escape(part)}</h2>'
    if isinstance(part, Drawing):
        return f'<figure>{part.svg}<figcaption>{escape(part.caption)}</figcaption></figure>'
    return _table(part)


def _table(table: Table) -> str:
    words = [cell[:1].isalpha() for cell in (table.rows or [table.head])[0]]

    def row(cells: Sequence[str], tag: str) -> str:
        kinds = [' class="word"' * word for word in words]
        columns = zip(cells, kinds, strict=True)
        return f'<tr>{"".join(f"<{tag}{kind}>{escape(c)}</{tag}>" for c, kind in columns)}</tr>'

    title = f'<h3>{escape(table.title)}</h3>' if table.title else ''
    rows = ''.join(row(cells, 'td') for cells in table.rows)
    note = f'<p class="note">{escape(table.note)}</p>' if table.note else ''
    head = f'<thead>{row(table.head, "th")}</thead>'
    return f'{title}<div class="scroll"><table>{head}<tbody>{rows}</tbody></table></div>{note}'


def _case(case: Case) -> str:
    buttons = ' '.join(f'<button type="button">{escape(name)}</button>' for name in case.poses)
    data = json.dumps(asdict(case)).replace('</', '<\\/')
    return (
        f'<figure class="case"><canvas width="760" height="520"></canvas><div>{buttons}</div>'
        f'<figcaption>{escape(case.caption)}</figcaption>'
        f'<script type="application/json">{data}</script></figure>'
    )
