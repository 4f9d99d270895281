"""A LiDAR simulator: procedural streets, spinning sensors, Open3D ray casting. All seeded.

primitives (shapes as triangles) → buildings, vegetation, furniture → terrain, street (a world)
→ sensors (beam tables, noise) → sequence (`SimulatedSequence`, the `Sequence` protocol).
"""
