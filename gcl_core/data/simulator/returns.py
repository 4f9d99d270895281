"""What a sensor makes of its hits: losses, noise, mixed pixels, rain, a blind sector."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from gcl_core.data.simulator.casting import Hits
from gcl_core.data.simulator.sensors import Sensor

MIXED = 0.35  # share of returns at an edge that lie between its two sides
MIXED_GAP = (0.2, 2.0)  # metres between the sides; a pulse is about 1.5 m long
MIN_RANGE = 1.5  # metres; nearer returns are the own vehicle's


@dataclass(frozen=True)
class Conditions:
    """What a sensor and its surroundings are like during one drive.

    Attributes:
        beam_bias: error of each beam's range, metres.
        lost: share of returns lost at random.
        rain: 0 is dry; 1 is heavy: weaker returns, mirrors on the road, drops near the sensor.
        blind: first and last angle that the vehicle hides, radians; None when nothing is hidden.
        deskew: share of the motion during a sweep that is taken out of the points.
    """

    beam_bias: Float32[np.ndarray, ' r']
    lost: float
    rain: float
    blind: tuple[float, float] | None
    deskew: float


def draw_conditions(sensor: Sensor, rng: np.random.Generator) -> Conditions:
    """Draw conditions: 10 % of drives are in rain, 20 % have a blind sector, 12 % raw motion."""
    bias = rng.normal(size=len(sensor.elevation_deg)) * rng.uniform(0.0, 0.02)
    rain = float(rng.uniform(0.2, 1.0)) if rng.random() < 0.1 else 0.0
    middle, half = rng.uniform(-np.pi, np.pi), np.deg2rad(rng.uniform(5, 40))
    blind = (middle - half, middle + half) if rng.random() < 0.2 else None
    deskew = 0.0 if rng.random() < 0.12 else float(np.clip(rng.normal(1.0, 0.06), 0.8, 1.2))
    return Conditions(bias.astype(np.float32), float(rng.uniform(0.01, 0.06)), rain, blind, deskew)


def measure(
    sensor: Sensor,
    hits: Hits,
    azimuth: Float32[np.ndarray, ' c'],
    conditions: Conditions,
    rng: np.random.Generator,
) -> Float32[np.ndarray, 'r c']:
    """Return the measured ranges, metres; 0 where nothing came back.

    A return's strength is reflectance x cosine x (max_range / range)^2 x speckle, less in rain;
    it is lost with rising probability as the strength falls below `weak_return`.
    """
    shape = hits.distance.shape
    gauss = rng.standard_normal(shape, dtype=np.float32)
    uniform = rng.random(shape, dtype=np.float32)
    true = np.minimum(hits.distance, 1e4)
    strength = hits.reflectance * hits.cosine * (sensor.max_range / np.maximum(true, 1.0)) ** 2
    if conditions.rain:
        # Drops weaken the beam on its way; a wet surface mirrors it away at grazing incidence.
        mirrored = np.maximum(hits.cosine, 1e-3) ** (0.6 * conditions.rain)
        strength = strength * mirrored * np.exp(-0.04 * conditions.rain * true)
    share = strength / (strength + 0.5 * sensor.weak_return)  # 2/3 at the threshold
    seen = (true > MIN_RANGE) & (true < sensor.max_range) & (uniform < share - conditions.lost)
    seen &= strength > 0.4 * sensor.weak_return
    # Noise grows with range and with slant, where the beam's footprint is long.
    slant = np.minimum(1.0 / np.maximum(hits.cosine, 0.1), 4.0)
    sigma = sensor.range_noise * (0.6 + 0.2 * slant + true / 120.0) + hits.depth
    measured = mix(true, rng) + gauss * sigma + conditions.beam_bias[:, None]
    if conditions.blind:
        angle = (azimuth - conditions.blind[0]) % (2 * np.pi)
        seen &= (angle > conditions.blind[1] - conditions.blind[0])[None]
    measured = np.where(seen, measured, 0.0).astype(np.float32)
    if conditions.rain:
        drops = rng.random(shape, dtype=np.float32) < 0.006 * conditions.rain
        measured[drops] = rng.exponential(5.0, int(drops.sum())) + MIN_RANGE
    return measured


def mix(
    distance: Float32[np.ndarray, 'r c'], rng: np.random.Generator
) -> Float32[np.ndarray, 'r c']:
    """Put some returns at the edge of two surfaces between them, as a wide beam does."""
    gap = np.diff(distance, axis=1)
    edge = (np.abs(gap) > MIXED_GAP[0]) & (np.abs(gap) < MIXED_GAP[1])
    row, column = np.nonzero(edge & (rng.random(gap.shape, dtype=np.float32) < MIXED))
    mixed = distance.copy()
    share = rng.random(len(row), dtype=np.float32)
    mixed[row, column] += share * gap[row, column]
    return mixed
