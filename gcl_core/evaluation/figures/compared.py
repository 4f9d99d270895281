"""The features that figures compare, and the places where they do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from gcl_core.data.sequence import Sequence
from gcl_core.evaluation.figures.result import BLUE, ORANGE, PURPLE
from gcl_core.evaluation.neighborhood import Neighborhood, neighborhoods
from gcl_core.evaluation.peers import fpfh_features
from gcl_core.matching.match import MatchConfig
from gcl_core.models import zoo
from gcl_core.registrar import Registrar
from gcl_core.types import Features, PointCloud

CENTRES = 3  # centre scans with their neighbours
Describe = Callable[[PointCloud], Features]
OURS, FPFH, BASELINE = 'GCL-ROS', 'FPFH', 'pair-wise'
COLORS = {OURS: BLUE, FPFH: ORANGE, BASELINE: PURPLE}


@dataclass(frozen=True)
class Compared:
    """What a figure of features is drawn from.

    Attributes:
        kinds: of features, each by its name.
        places: centre scans with their neighbours.
        match: how the registrar matches.
        seed: of what a figure draws at random.
    """

    kinds: dict[str, Describe]
    places: list[Neighborhood]
    match: MatchConfig
    seed: int

    @property
    def drives(self) -> str:
        """Names of those that the places are of."""
        return ', '.join(sorted({place.sequence for place in self.places}))


def compare(
    registrar: Registrar,
    sequences: Mapping[str, Sequence],
    *,
    seed: int = 0,
    baseline: str = '',
) -> Compared:
    """Ours, FPFH, and a network trained pair by pair if its weights are given.

    Args:
        registrar: holds our network.
        sequences: drives.
        seed: of the places, and of what a figure draws at random.
        baseline: name or file of weights; empty leaves it out.

    Raises:
        GclError: no such weights, or a sequence has no two scans within 60 m.
    """
    kinds: dict[str, Describe] = {
        OURS: lambda cloud: registrar.model.describe([cloud])[0],
        FPFH: fpfh_features,
    }
    if baseline:
        network = zoo.load_weights(baseline)
        network.dtype = registrar.model.dtype
        kinds[BASELINE] = lambda cloud: network.describe([cloud])[0]
    places = list(neighborhoods(sequences, CENTRES, seed))
    return Compared(kinds, places, registrar.config.match, seed)
