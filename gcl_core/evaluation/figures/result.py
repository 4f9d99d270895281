"""What a figure hands over, and how it is drawn."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

from gcl_core.evaluation.plots import NO_METADATA

# Okabe and Ito's palette (2008), which colour-blind readers can tell apart.
BLUE, ORANGE, GREEN, RED = '#0072b2', '#e69f00', '#009e73', '#d55e00'
PURPLE, SKY, GREY = '#cc79a7', '#56b4e9', '#8a8a8a'

Row = dict[str, Any]


@dataclass(frozen=True)
class FigureResult:
    """One figure.

    Attributes:
        name: of the figure, as in the YAML of a benchmark.
        caption: what is drawn, from how many scans, and what to look for.
        svg: the picture, an SVG document; empty if there are only numbers.
        rows: the numbers drawn, as JSON takes them.
        published: what the paper states for the same figure and where; empty if nothing.
    """

    name: str
    caption: str
    svg: str
    rows: list[Row]
    published: str


def new_figure(width: float, height: float) -> Any:
    """Matplotlib figure of so many inches, without any window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout='constrained')


def to_svg(figure: Any, name: str) -> str:
    """Render; the same figure gives the same text.

    Args:
        figure: of `new_figure`.
        name: keeps the identifiers of several figures on one page apart.
    """
    import matplotlib

    text = io.StringIO()
    with matplotlib.rc_context({'svg.hashsalt': name, 'svg.fonttype': 'none'}):
        figure.savefig(text, format='svg', dpi=150, metadata=NO_METADATA)
    return text.getvalue()


def tidy(axes: Any, *, x: str, y: str, title: str = '') -> None:
    """Label axes, left and bottom lines only, a faint grid."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, fontsize=10, loc='left')
    axes.spines[['top', 'right']].set_visible(False)
    axes.grid(alpha=0.25, linewidth=0.6)
    axes.set_axisbelow(True)


def legend(axes: Any) -> None:
    """Name what is drawn."""
    axes.legend(frameon=False, fontsize=9)


def level(axes: Any, y: float, *, label: str | None = None) -> None:
    """Draw a dotted line to hold the curves against."""
    axes.axhline(y, color='black', linewidth=0.8, linestyle=':', label=label)
