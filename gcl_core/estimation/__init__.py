"""Correspondences to a transform: minimal solvers, RANSAC, refinement on the full scans."""
