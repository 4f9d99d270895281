"""Features of two scans to correspondences."""
