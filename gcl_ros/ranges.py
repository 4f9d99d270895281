"""Smallest and largest value of numeric parameters, by the end of their dotted names."""

from __future__ import annotations

RANGES: dict[str, tuple[float, float]] = {
    'max_pair_dt': (0.0, 10.0),
    'silence': (0.1, 3600.0),
    'max_age': (0.01, 3600.0),
    'max_rate': (0.01, 1000.0),
    'voxel_size': (0.01, 10.0),
    'max_range': (1.0, 1000.0),
    'residual_bits': (0, 8),
    'sweep': (0.0, 1.0),
    'max_coast': (0.01, 3600.0),
    'distance': (0.0, 1.0),
    'turn': (0.0, 1.0),
    'still': (0.0, 10.0),
    'headings': (1, 12),
    'max_distance': (1.0, 1000.0),
    'min_probability': (0.0, 1.0),
    'k': (1, 20),
    'keypoints': (1, 20_000),
    'max_points': (1, 100_000_000),
    'threshold': (0.01, 10.0),
    'samples': (1, 100_000_000),
    'batch': (1, 10_000_000),
    'confidence': (0.0, 1.0),
    'edge_ratio': (0.0, 1.0),
    'min_edge': (0.0, 100.0),
    'max_height_difference': (0.0, 100.0),
    'local_steps': (0, 100),
    'keep': (1, 1000),
    'correspondences': (3, 100_000),
    'seeds': (1, 100_000),
    'members': (3, 10_000),
    'points': (3, 10),
    'hypotheses': (1, 1000),
    'finalists': (1, 100),
    'tolerance': (0.01, 10.0),
    'fine_tolerance': (0.01, 10.0),
    'iterations': (1, 1000),
    'max_move': (0.0, 100.0),
    'max_turn_deg': (0.0, 180.0),
    'threads': (1, 256),
}


def range_of(name: str) -> tuple[float, float] | None:
    """Range of a parameter such as `registrar.headings`; None where any value may do."""
    return RANGES.get(name.rsplit('.', 1)[-1])
