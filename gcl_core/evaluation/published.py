"""The paper's published figures, to stand beside ours and be told from them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import yaml

from gcl_core.config import from_mapping
from gcl_core.errors import GclError
from gcl_core.evaluation.tables import Table

FILE = Path(__file__).with_name('published.yaml')


@dataclass(frozen=True)
class Published:
    """A table of the paper.

    Attributes:
        name: its label in the paper's source, such as `comparison_kitti`.
        title: what it shows.
        criterion: when a pair counted.
        head: columns.
        rows: the name of a method, then its figures.
    """

    name: str
    title: str
    criterion: str
    head: tuple[str, ...]
    rows: tuple[tuple[str | float, ...], ...]

    @property
    def table(self) -> Table:
        """As printed, marked as published."""
        rows = [tuple(str(cell) for cell in row) for row in self.rows]
        note = f'Published (Liu et al., ICCV 2023, table {self.name}); {self.criterion}.'
        return Table(f'{self.title}, as published', self.head, rows, note)

    @property
    def curves(self) -> dict[str, list[float]]:
        """Recall in the paper's five bins by method; empty for other tables."""
        if 'mRR' not in self.head:
            return {}
        return {str(row[0]): [float(x) for x in row[2:]] for row in self.rows}

    @property
    def strict(self) -> bool:
        """Whether its recalls are by the strict criterion."""
        return self.criterion.startswith('strict')


def published(name: str) -> Published:
    """Look a table up.

    Raises:
        GclError: there is none of that name.
    """
    tables = yaml.safe_load(FILE.read_text())
    if name not in tables:
        raise GclError(f'no published table {name!r}; there are {", ".join(tables)}')
    rows = tuple(tuple(row) for row in tables[name].pop('rows'))
    found = from_mapping(Published, {'name': name, 'rows': (), **tables[name]}, str(FILE))
    return Published(name, found.title, found.criterion, found.head, rows)
