"""Distant registration of LiDAR scans with density-invariant features (GCL, ICCV 2023).

The way of the data, each arrow a type of `gcl_core.types`, each verb a folder:

    PointCloud2 ─ gcl_ros.conversions ─▶ PointCloud ─ ops.heading, ops.voxelize ─▶ SparseTensor
      ─ models ─▶ Features ─ matching ─▶ Correspondences
      ─ estimation ─▶ Registration (T_target_source, accepted) ─ gcl_ros ─▶ TransformStamped

Training branches off at Features: data.groups ─▶ PositiveGroups ─▶ losses ─▶ training.
Evaluation branches off at Registration: evaluation.plan ─▶ runner ─▶ score ─▶ report.
`registrar.py` is the whole of it on one page. Nothing here imports rclpy.
"""

import os

# Read when torch loads OpenMP: threads that wait sleep instead of spinning, so that the cores are
# free for the rest of the robot.
os.environ.setdefault('OMP_WAIT_POLICY', 'PASSIVE')
