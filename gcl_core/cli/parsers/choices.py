"""Names to choose from, written out: where they live, torch or Open3D is loaded with them."""

LAYOUTS = ('eth', 'folder', 'kitti', 'nuscenes', 'rosbag2')
SENSORS = ('hdl32e', 'hdl32e_20hz', 'hdl64e', 'os1_128', 'pandar128', 'solid120', 'vlp16')
KINDS = ('avenue', 'canyon', 'industrial', 'mixed', 'park', 'residential', 'rural', 'terraces')
MANOEUVRES = ('oncoming', 'following', 'crossing', 'turning')
PEERS = ('fpfh', 'fpfh_fgr', 'gicp', 'kiss_matcher')
ESTIMATORS = ('ransac', 'spatial_consistency', 'open3d_ransac', 'kiss_matcher', 'paper')
STORAGES = ('mcap', 'sqlite3')
