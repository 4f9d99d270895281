"""The paper's analysis figures, from any drive: `FIGURES[name](registrar, sequences, seed=0)`.

`python -m gcl_core.evaluation.figures drift --data DIR --sequence 80 --out drift.svg` draws one.
"""

from __future__ import annotations

from collections.abc import Callable

from gcl_core.evaluation.figures.correlation import correlation_figure
from gcl_core.evaluation.figures.drift import drift_figure
from gcl_core.evaluation.figures.inliers import inliers_figure
from gcl_core.evaluation.figures.positives import positives_figure
from gcl_core.evaluation.figures.result import FigureResult

FIGURES: dict[str, Callable[..., FigureResult]] = {
    'correlation': correlation_figure,
    'positives': positives_figure,
    'drift': drift_figure,
    'inliers': inliers_figure,
}
__all__ = ['FIGURES', 'FigureResult']
