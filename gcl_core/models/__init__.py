"""Networks that describe scans: `describe(PointCloud) -> Features`, one contract for all."""
