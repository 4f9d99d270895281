"""A LiDAR simulator: procedural worlds, moving traffic, many sensors, Open3D ray casting. Seeded.

primitives (shapes as triangles), surfaces (what they return) → buildings, vegetation, furniture,
vehicles → lots (what stands beside a road) and terrain, mixed by kinds → street (a world that
stands still), traffic (what moves) → drive (poses) → casting, returns (losses, noise) → sweep
(one scan) → sequence (`SimulatedSequence`, the `Sequence` protocol), meeting (two vehicles).
"""
