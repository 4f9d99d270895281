"""Score predictions and write results.json, results.md and report.html."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from gcl_core.evaluation.benchmark import Ours
from gcl_core.evaluation.cases import Case, case, worst
from gcl_core.evaluation.contestants import registrar
from gcl_core.evaluation.eth_recall import eth_recall
from gcl_core.evaluation.figures import OF_FEATURES, OF_POSITIVES, compare
from gcl_core.evaluation.page import Drawing, page
from gcl_core.evaluation.plots import recall_over_distance, svg
from gcl_core.evaluation.predict import Prediction
from gcl_core.evaluation.published import Published, published
from gcl_core.evaluation.runner import Run
from gcl_core.evaluation.score import Row, by_overlap, by_sensors, by_yaw, score
from gcl_core.evaluation.tables import Table, recall, stages, summary
from gcl_core.files import write_text
from gcl_core.registrar import Registrar
from gcl_core.to_json import to_json

BREAKDOWNS = {
    'difference in heading, °': by_yaw,
    'overlap, %': by_overlap,
    'sensors of source and target': by_sensors,
}


@dataclass(frozen=True)
class Results:
    """Everything that a run came to.

    Attributes:
        rows: by distance.
        breakdowns: rows by other properties of the pairs, by its name.
        tables: of rows, breakdowns, stages and figures, as they are shown.
        more: those of stages and figures.
        drawings: plots and analysis figures.
        figures: what the analysis figures are made of, for the JSON.
        published: tables of the paper.
        facts: what was measured, where and when.
    """

    rows: list[Row]
    breakdowns: dict[str, list[Row]]
    tables: list[Table]
    more: list[Table]
    drawings: list[Drawing]
    figures: list[dict[str, Any]]
    published: list[Published]
    facts: dict[str, str]


def write(run: Run, predictions: Sequence[Prediction], results: Results) -> None:
    """Write results and figures into the run's folder; the worst cases' scans are read again."""
    folder, first = run.folder, bool(results.rows)
    write_text(folder / 'results.json', to_json(content(run, results), indent=1))
    write_text(folder / 'results.md', in_markdown(run.config.title, results))
    page_ = page(
        run.config.title,
        results.facts,
        [*results.tables[:first], *results.drawings, *results.tables[first:]],
        list(_cases(run, predictions)),
        [p.table for p in results.published],
    )
    write_text(folder / 'report.html', page_)
    for number, drawing in enumerate(results.drawings, 1):
        write_text(folder / f'figure_{number}.svg', drawing.svg)


def gather(run: Run, predictions: Sequence[Prediction]) -> Results:
    """Score, break down, draw; write nothing."""
    config = run.config
    rows = score(predictions, criteria=config.criteria)
    scored = {name: score(predictions, by, config.criteria) for name, by in BREAKDOWNS.items()}
    breakdowns = {k: found for k, found in scored.items() if len({row.bin for row in found}) > 1}
    tables = [summary(rows), recall(rows, title='By distance', criteria=config.criteria)]
    tables = tables if rows else []
    tables += [
        recall(found, name, title=f'By {name}', criteria=config.criteria)
        for name, found in breakdowns.items()
    ]
    more = [t for t in [stages(predictions)] if t]
    shown = [published(name) for name in config.published]
    drawings = list(_plots(rows, shown))
    figures = _figures(run)
    for figure in figures:
        svg_ = figure.pop('svg')
        if svg_:
            drawings.append(Drawing(_told(figure), svg_[svg_.index('<svg') :]))
        more += [_figure_table(figure)] if figure['rows'] else []
    tables += more
    return Results(rows, breakdowns, tables, more, drawings, figures, shown, _facts(run))


def _facts(run: Run) -> dict[str, str]:
    pairs = '; '.join(f'{d.dataset}: {d.pairs.label}' for d in run.drawn)
    turned = 'by a random heading' if run.config.random_yaw else 'not'
    sequences = ', '.join(sequence.name for sequence in run.sequences.values())
    facts = {'sequences': sequences, 'pairs': pairs, 'source turned': turned}
    return facts | {key: str(value) for key, value in run.provenance.items()}


def _plots(rows: list[Row], shown: list[Published]) -> Iterator[Drawing]:
    """Recall over distance of every set, by both criteria, the published curves of that one."""
    counts: tuple[tuple[str, Callable[[Row], int]], ...] = (
        ('strict (0.6 m, 1.5°)', lambda row: row.strict),
        ('loose (2 m, 5°)', lambda row: row.loose),
    )
    for dataset in dict.fromkeys(row.dataset for row in rows):
        own = [row for row in rows if row.dataset == dataset]
        for strict, (name, count) in zip((True, False), counts, strict=True):
            curves = {m: c for p in shown if p.strict == strict for m, c in p.curves.items()}
            title = f'{dataset}, {name}'
            drawn = recall_over_distance(own, count, title=title, published=curves)
            note = ' Dashed: published, on the paper’s own pairs.' if curves else ''
            yield Drawing(f'Recall over distance, {title}, 95 % intervals.{note}', svg(drawn))


def _figures(run: Run) -> list[dict[str, Any]]:
    """Draw the analysis figures: all our methods in one, but for a table of ETH of each."""
    names, seed = run.config.figures, run.config.seed
    drawn = [('', OF_POSITIVES[n](run.sequences, seed=seed)) for n in names if n in OF_POSITIVES]
    ours: dict[str, Registrar] = {}
    if {*names} - {*OF_POSITIVES}:
        ours = {m.name: registrar(m) for m in run.config.methods if isinstance(m, Ours)}
    if of_features := [name for name in names if name in OF_FEATURES]:
        compared = compare(ours, run.sequences, seed=seed)
        drawn += [('', OF_FEATURES[name](compared)) for name in of_features]
    if 'eth_recall' in names:
        drawn += [(name, eth_recall(own, run.sequences)) for name, own in ours.items()]
    return [{**asdict(result), 'method': method} for method, result in drawn]


def _figure_table(figure: dict[str, Any]) -> Table:
    head = tuple(dict.fromkeys(key for row in figure['rows'] for key in row))
    cells = [tuple(_cell(row.get(key, '')) for key in head) for row in figure['rows']]
    title = ', '.join(filter(None, (f'Figure {figure["name"]}', figure['method'])))
    return Table(title, head, cells, _told(figure))


def _cell(value: Any) -> str:
    if isinstance(value, list):
        return ', '.join(map(_cell, value))
    return f'{value:.4g}' if isinstance(value, float) else str(value)


def _told(figure: dict[str, Any]) -> str:
    """Caption, and what the paper states, marked as published."""
    return f'{figure["caption"]} Published: {figure["published"]}'


def _cases(run: Run, predictions: Sequence[Prediction]) -> Iterator[Case]:
    """The worst pairs of the first method."""
    drives = {sequence.name: sequence for sequence in run.sequences.values()}
    first = next(iter(run.config.estimators))
    for prediction in worst([p for p in predictions if p.method == first], run.config.worst):
        yield case(prediction, drives)


def in_markdown(title: str, results: Results) -> str:
    """All tables, ours and the published ones."""
    facts = '\n'.join(f'- {key}: {value}' for key, value in results.facts.items())
    parts = [f'# {title}', facts]
    for table in [*results.tables, *(p.table for p in results.published)]:
        parts += [f'## {table.title}', table.markdown(), *([table.note] if table.note else [])]
    return '\n\n'.join(parts) + '\n'


def content(run: Run, results: Results) -> dict[str, Any]:
    """What results.json holds."""
    return {
        'title': run.config.title,
        **results.facts,
        'sequences': [sequence.name for sequence in run.sequences.values()],
        'pairs': [
            {
                'dataset': d.dataset,
                'name': d.pairs.name,
                'count': len(d.pairs.pairs),
                'sha256': d.pairs.sha256,
            }
            for d in run.drawn
        ],
        'config': asdict(run.config),
        'rows': [asdict(row) for row in results.rows],
        'breakdowns': {k: [asdict(row) for row in v] for k, v in results.breakdowns.items()},
        'figures': results.figures,
        'published': [asdict(p) for p in results.published],
    }
