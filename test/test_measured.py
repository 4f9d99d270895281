"""Figures in prose are those of the JSON that they name, and that JSON is of a known commit.

A page holds beside its figures a comment with sentences or rows as they must stand in it, written
as f-strings over the JSON, after names for what they share:

    <!-- figures: bench/trust.json
    mirrored = of('mirrored')
    {number(mirrored.wrong)} of {mirrored.pairs} mirrored copies
    -->

After a benchmark was run anew, the failing tests print what the page has to say.
"""

import json
import re
import subprocess
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace

import pytest

from gcl_core import provenance
from gcl_core.errors import GclError
from gcl_core.evaluation.metrics import wilson

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]
WRITTEN = {'results.md'}  # by the benchmark itself, with its JSON
COMMENT = re.compile(r'<!-- figures: (\S+)\n(.*?)-->', re.DOTALL)
LINK = re.compile(r'\]\(\.\./(bench/\w+\.json)\)')


def number(value):
    """A count as the pages write it."""
    return 'none' if value == 0 else f'{value:,}'


def names(data):
    """What the templates of a JSON may use: its keys, and sums over its rows."""

    def of(*kinds):
        rows = [row for row in data['by_kind'] if row['kind'] in kinds]
        assert len(rows) == len(kinds), f'{kinds} are not all among the kinds of pairs'
        sums = {key: sum(row[key] for row in rows) for key in ('pairs', 'accepted', 'wrong')}
        low, high = wilson(sums['wrong'], sums['pairs'])
        percent = f'{100 * low:.2f}–{100 * high:.2f}'
        return SimpleNamespace(**sums, percent=percent, most=100 * high)

    def estimator(method):
        rows = [row for row in data['rows'] if row['method'] == method]
        cells = [f'{100 * row["strict"] / row["pairs"]:.0f}' for row in rows]
        found = [row for row in rows if row['rte_median'] is not None]
        cells.append(f'{sum(row["wrong"] for row in rows)}')
        cells += [
            f'{max(row[key] for row in found):.2f}' for key in ('rte_median', 'rre_median_deg')
        ]
        seconds = sorted(row['seconds'] for row in rows)
        digits = 2 if seconds[-1] < 1 else 0
        cells.append(f'{seconds[0]:.{digits}f}–{seconds[-1]:.{digits}f}')
        return ' | '.join([*method.split(' + '), *cells])

    def compact(source):
        (row,) = [
            row
            for row in data['sizes']
            if (row['source'], row['voxel_size_m']) == (source, data['default_voxel_size_m'])
        ]
        cells = [
            f'{row[key]:,.0f}'
            for key in ('voxels_median', 'bytes_median', 'bytes_p95', 'draco_bytes_median')
        ]
        cells += [f'{row[key]:.1f}' for key in ('encode_ms_median', 'decode_ms_median')]
        return ' | '.join([source, str(row['scans']), *cells])

    helpers = {
        'of': of,
        'compact': compact,
        'estimator': estimator,
        'number': number,
        'data': data,
    }
    helpers |= {'sum': sum, 'len': len}
    return (data if isinstance(data, dict) else {}) | helpers


def plain(text):
    """Text without comments and line ends."""
    return ' '.join(COMMENT.sub('', text).split())


def comments():
    """Page, JSON and lines of every comment."""
    for page in PAGES:
        for source, lines in COMMENT.findall(page.read_text()):
            yield pytest.param(page, source, lines, id=f'{page.name}: {source}')


@pytest.mark.parametrize(('page', 'source', 'lines'), list(comments()))
def test_figures_are_those_of_the_json(page, source, lines):
    known = {'__builtins__': {}} | names(json.loads((ROOT / source).read_text()))
    said, missing = plain(page.read_text()), []
    for line in filter(None, map(str.strip, lines.splitlines())):
        if name := re.match(r'(\w+) = ', line):
            known[name[1]] = eval(line[name.end() :], known)
        elif (text := eval(f'f{line!r}', known)) not in said:
            missing.append(text)
    assert not missing, f'{page.name} has to say, as {source} does'


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_a_page_that_names_a_json_is_held_to_it(page):
    held = {source for source, _ in COMMENT.findall(page.read_text())}
    assert page.name in WRITTEN or set(LINK.findall(page.read_text())) <= held


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_figures_of_an_unknown_version_are_said_to_be(page):
    for source in LINK.findall(page.read_text()):
        data = json.loads((ROOT / source).read_text())
        known = data if isinstance(data, dict) else {}
        commit = known.get('provenance', known).get('commit', '')
        if commit.endswith('-dirty'):
            said = f'at {commit.removesuffix("-dirty")} with changes that were not committed'
            assert said in plain(page.read_text()), source


def tables(page):
    """Every table of a page by its header: rows by their first cell."""
    found = {}
    for text in re.findall(r'(?:^\|.*\n)+', COMMENT.sub('', page.read_text()), re.MULTILINE):
        head, _, *lines = text.splitlines()
        rows = [[cell.strip() for cell in line.strip('|').split('|')] for line in lines]
        found[head] = {row[0]: row[1:] for row in rows}
    return found


def test_a_table_that_stands_twice_says_the_same():
    compared = 0
    for one, other in combinations(PAGES, 2):
        first, second = tables(one), tables(other)
        for head in first.keys() & second.keys() - {'| | |'}:
            shared = first[head].keys() & second[head].keys()
            assert {k: first[head][k] for k in shared} == {k: second[head][k] for k in shared}
            compared += len(shared)
    assert compared >= 4  # of "How well it works" and "In short", in README.md and measured.md


# Benchmarks do not write into the repository what no commit can make again


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """A repository with a program, results and a page, of which everything is committed."""

    def git(*arguments):
        subprocess.run(['git', *arguments], cwd=tmp_path, check=True, capture_output=True)

    for name in ('bench/old.json', 'docs/page.md', 'gcl_core/program.py'):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text('first\n')
    git('init')
    git('add', '-A')
    git('-c', 'user.name=x', '-c', 'user.email=x@y', 'commit', '-m', 'first')
    monkeypatch.setattr(provenance, 'ROOT', tmp_path)
    return tmp_path


def test_a_clean_tree_may_write_results_one_after_the_other(repository):
    for name in ('old.json', 'new.json'):
        measured = provenance.provenance_for(repository / 'bench' / name)
        assert re.fullmatch(r'[0-9a-f]{7,}', measured['commit'])
        (repository / 'bench' / name).write_text('second\n')
    (repository / 'docs/page.md').write_text('second\n')
    assert provenance.provenance_for(repository / 'bench/old.json') == measured


def test_a_dirty_tree_may_not_write_results_into_the_repository(repository, tmp_path_factory):
    (repository / 'gcl_core/program.py').write_text('second\n')
    elsewhere = tmp_path_factory.mktemp('elsewhere') / 'old.json'
    assert provenance.provenance_for(elsewhere)['commit'].endswith('-dirty')
    for path in ('bench/old.json', 'bench/new.json', 'docs/results.md'):
        with pytest.raises(GclError, match=rf'{path}: .*program\.py.*commit.*--out'):
            provenance.provenance_for(elsewhere, repository / path)
    (repository / 'gcl_core/program.py').write_text('first\n')
    (repository / 'gcl_core/other.py').write_text('new\n')
    with pytest.raises(GclError, match=r'other\.py'):
        provenance.provenance_for(repository / 'bench/old.json')


@pytest.mark.parametrize(
    'module',
    [
        'gcl_core.bench.' + name
        for name in ('engine', 'registration', 'backbones', 'results', 'compact')
    ]
    + ['gcl_core.evaluation.false_accepts', 'gcl_ros.bench_link']
    + ['gcl_ros.fuzz.__main__', 'gcl_ros.soak.__main__'],
)
def test_every_benchmark_asks_before_it_measures(module, repository, monkeypatch):
    """Whatever it would measure, a dirty tree ends it at once."""
    import importlib

    (repository / 'gcl_core/program.py').write_text('second\n')
    arguments = ['--out', str(repository / 'bench/new.json')]
    monkeypatch.setattr('sys.argv', [module, *arguments])
    program = importlib.import_module(module)
    with pytest.raises((GclError, SystemExit)) as ended:
        program.main()
    assert isinstance(ended.value, GclError) or ended.value.code == 2
    assert not (repository / 'bench/new.json').exists()
