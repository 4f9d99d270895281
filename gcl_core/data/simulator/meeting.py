"""Two vehicles in one world: oncoming, one after the other, or crossing paths."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from gcl_core.data.simulator.drive import nearest_crossing
from gcl_core.data.simulator.sequence import SimulatedSequence, World
from gcl_core.errors import GclError

Manoeuvre = Literal['oncoming', 'following', 'crossing', 'turning']


def meet(
    seed: int,
    manoeuvre: Manoeuvre | None = None,
    *,
    sensors: tuple[str, str] = ('hdl64e', 'hdl64e'),
    kind: str | None = None,
    spacing: float = 1.0,
) -> tuple[SimulatedSequence, SimulatedSequence]:
    """Drive two vehicles through one world by one clock; each sees the other.

    Scan i of both is the same moment; they come nearest to each other in the middle of their
    drives, but for one that follows, which keeps its distance.

    Args:
        seed: everything follows from it.
        manoeuvre: of the second vehicle against the first, which keeps to the road; drawn from
            the seed when None, among those that the street allows.
        sensors: of the first and of the second vehicle.
        kind: kind of place; drawn from the seed when None.
        spacing: metres between scans of the first vehicle.

    Raises:
        GclError: unknown manoeuvre, or the street has no crossing for it.
    """
    world = World(seed, kind)
    rng = np.random.default_rng([seed, 9])
    crossings = any(abs(c[0]) < 80.0 for c in world.street.terrain.crossings)
    if manoeuvre is None:
        choices = get_args(Manoeuvre) if crossings else ('oncoming', 'following')
        manoeuvre = rng.choice(choices)
    if manoeuvre not in get_args(Manoeuvre):
        known = ', '.join(get_args(Manoeuvre))
        raise GclError(f'unknown manoeuvre {manoeuvre!r}; choose one of {known}')
    gap = float(rng.uniform(8.0, 40.0))

    def vehicle(
        number: int, route: str, lead: float, span: float, pace: float = 1.0
    ) -> SimulatedSequence:
        return SimulatedSequence(
            seed,
            sensor=sensors[number],
            span=span * pace,
            spacing=spacing * pace,
            route=route,  # type: ignore[arg-type]
            lead=lead,
            world=world,
        )

    if manoeuvre == 'oncoming':
        along, against = world.traffic.lane_speed
        pace = against / along
        pair = vehicle(0, 'along', 0.0, 130.0), vehicle(1, 'oncoming', 0.0, 130.0, pace)
    elif manoeuvre == 'following':
        pair = vehicle(0, 'along', 0.0, 150.0), vehicle(1, 'along', gap, 150.0)
    else:
        where, _ = nearest_crossing(world.street.terrain)
        route = 'across' if manoeuvre == 'crossing' else 'turning'
        pair = vehicle(0, 'along', where, 120.0), vehicle(1, route, -gap, 120.0)
    pair[0].others, pair[1].others = (pair[1],), (pair[0],)
    return pair
