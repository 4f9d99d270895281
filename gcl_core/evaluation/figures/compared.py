"""The features that figures compare, and the places where they do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import cycle
from typing import Any

from gcl_core import se3
from gcl_core.data.sequence import Sequence
from gcl_core.evaluation.figures.result import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY
from gcl_core.evaluation.neighborhood import Neighborhood, neighborhoods
from gcl_core.evaluation.peers import fpfh_features
from gcl_core.matching.match import MatchConfig
from gcl_core.models.backbone import Backbone
from gcl_core.registrar import Registrar
from gcl_core.types import Features

CENTRES = 3  # centre scans with their neighbours
PALETTE = (BLUE, PURPLE, GREEN, RED, SKY, GREY)  # FPFH is orange


@dataclass(frozen=True)
class Compared:
    """What the figures of features are drawn from; every scan is described once.

    Attributes:
        places: centre scans with their neighbours.
        features: by the name of who describes; of each place, of each of its clouds.
        match: how the first registrar matches.
        seed: of what a figure draws at random.
    """

    places: list[Neighborhood]
    features: dict[str, list[list[Features]]]
    match: MatchConfig
    seed: int

    @property
    def drives(self) -> str:
        """Names of those that the places are of."""
        return ', '.join(sorted({place.sequence for place in self.places}))

    @property
    def colors(self) -> dict[str, str]:
        """Colour of each name."""
        return dict(zip(self.features, cycle(PALETTE))) | {'FPFH': ORANGE}


def compare(
    registrars: Mapping[str, Registrar], sequences: Mapping[str, Sequence], *, seed: int = 0
) -> Compared:
    """Describe the scans of a few places by every registrar's network, and by FPFH.

    The scans of a place are described at one heading, the centre's street where a network wants
    it so: what is compared are features, not how well a heading is found.

    Args:
        registrars: by name; at least one.
        sequences: drives.
        seed: of the places, and of what a figure draws at random.

    Raises:
        GclError: a sequence has no two scans within 60 m.
    """
    networks = {name: registrar.model for name, registrar in registrars.items()}
    places = list(neighborhoods(sequences, CENTRES, seed))
    features = {
        name: [_describe(network, place) for place in places] for name, network in networks.items()
    }
    features['FPFH'] = [[fpfh_features(cloud) for cloud in place.clouds] for place in places]
    return Compared(places, features, next(iter(registrars.values())).config.match, seed)


def _describe(network: Backbone[Any, Any], place: Neighborhood) -> list[Features]:
    T_view_centre = network.facing(place.clouds[0])
    return [
        network.describe_facing(cloud, T_view_centre @ se3.from_xyz_rpy(yaw=se3.yaw(T)))
        for cloud, T in zip(place.clouds, place.T_centre_scan, strict=True)
    ]
