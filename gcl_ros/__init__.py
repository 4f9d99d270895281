"""ROS 2 around gcl_core: conversions, pairing by stamp, the registrar node, bags and their replay.

PointCloud2 ─ conversions ─▶ PointCloud ─ gcl_core.registrar ─▶ Registration ─▶ TransformStamped
"""
