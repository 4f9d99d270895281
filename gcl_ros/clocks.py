"""Stamps of another clock than the node's: by how much, and which clock it is likely to be."""

from __future__ import annotations

AHEAD = 0.5  # seconds: a stamp is of the past, but for the jitter of clocks and of /clock
START = 1e8  # seconds, three years: stamps below it do not count from 1970
NEAR = 1.0  # seconds that a stamp has been under way at most, for its clock to be recognised
SCALES = ((37.0, 'TAI, as PTP sends it without its UTC offset'), (18.0, 'GPS time'))
ZONE, FARTHEST = 1800.0, 14 * 3600.0  # seconds: time zones lie half-hours apart, up to 14 hours
DAY = 86400.0


def another_clock(stamp: float, behind: float, late: float) -> str:
    """What a topic has, where its stamps are of another clock; empty where they are not.

    Args:
        stamp: seconds.
        behind: the node's clock when the message came minus the stamp, seconds.
        late: how much of that is no fault of the clock.
    """
    if -AHEAD <= behind <= late:
        return ''
    if stamp == 0:
        return 'has stamps of 0: its driver does not set them'
    if stamp + behind < 1:
        return (
            f'has stamps {-behind:.0f} s ahead of the clock of the node, which stands at 0: '
            'use_sim_time is set, but does anybody publish /clock?'
        )
    side, apart = ('ahead of', -behind) if behind < 0 else ('behind', behind)
    figure = f'{apart:.1f}' if apart < DAY else f'{apart:.0f}'
    return f'has stamps {figure} s {side} the clock of the node: {_cause(stamp, behind)}'


def _cause(stamp: float, behind: float) -> str:
    """The clock that stamps so far off are likely to be of."""
    apart = abs(behind)
    for offset, scale in SCALES:
        if abs(apart - offset) < NEAR:
            return f'{"the sensor" if behind < 0 else "this machine"} tells {scale}?'
    zones = round(behind / ZONE)
    if zones and apart < FARTHEST + NEAR and abs(behind - zones * ZONE) < NEAR:
        return f'local time, {-zones / 2:+g} h, in place of UTC?'
    if stamp < START:
        return (
            'they count from a start, of the sensor or of a simulation: synchronise the sensor, '
            'or set use_sim_time'
        )
    if apart > DAY:
        return 'is use_sim_time as they need it, or is a clock not set?'
    return 'are the clocks synchronised, or is the way of the messages slow?'
