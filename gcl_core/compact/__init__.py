"""A scan as a vehicle sends it: 10 kB instead of 2 MB, and any other vehicle can describe it.

`scan.encode` and `scan.decode` are the whole of it: points to occupied voxels, voxels to an octree
(`octree`), its decisions to bytes (`range_coder`), a header before them. Nothing here needs ROS.
"""
