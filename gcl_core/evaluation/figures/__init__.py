"""The paper's analysis figures, from any drive: of positives, and of the features at them.

`python -m gcl_core.evaluation.figures drift --data DIR --sequence 80 --out drift.svg` draws one.
"""

from __future__ import annotations

from collections.abc import Callable

from gcl_core.evaluation.figures.compared import Compared, compare
from gcl_core.evaluation.figures.correlation import correlation_figure
from gcl_core.evaluation.figures.drift import drift_figure
from gcl_core.evaluation.figures.inliers import inliers_figure
from gcl_core.evaluation.figures.positives import positives_figure
from gcl_core.evaluation.figures.result import FigureResult

OF_POSITIVES: dict[str, Callable[..., FigureResult]] = {  # of (sequences, seed=0)
    'correlation': correlation_figure,
    'positives': positives_figure,
}
OF_FEATURES: dict[str, Callable[[Compared], FigureResult]] = {
    'drift': drift_figure,
    'inliers': inliers_figure,
}
__all__ = ['OF_FEATURES', 'OF_POSITIVES', 'FigureResult', 'compare']
