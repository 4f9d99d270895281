"""The features that figures compare, by name."""

from __future__ import annotations

from collections.abc import Callable

from gcl_core.evaluation.figures.result import BLUE, ORANGE, PURPLE
from gcl_core.evaluation.peers import fpfh_features
from gcl_core.models import zoo
from gcl_core.registrar import Registrar
from gcl_core.types import Features, PointCloud

Describe = Callable[[PointCloud], Features]
OURS, FPFH, BASELINE = 'GCL-ROS', 'FPFH', 'pair-wise'
COLORS = {OURS: BLUE, FPFH: ORANGE, BASELINE: PURPLE}


def describers(registrar: Registrar, baseline: str = '') -> dict[str, Describe]:
    """Ours, FPFH, and a network trained pair by pair if its weights are given.

    Args:
        registrar: holds our network.
        baseline: name or file of weights; empty leaves it out.

    Raises:
        GclError: no such weights.
    """
    found: dict[str, Describe] = {
        OURS: lambda cloud: registrar.model.describe([cloud])[0],
        FPFH: fpfh_features,
    }
    if baseline:
        network = zoo.load_weights(baseline)
        network.dtype = registrar.model.dtype
        found[BASELINE] = lambda cloud: network.describe([cloud])[0]
    return found
