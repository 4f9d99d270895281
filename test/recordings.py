"""Bags as recorders leave them: messages of rosbags, and how they are written."""

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer

from gcl_core import se3
from gcl_ros.bag import VERSION
from gcl_ros.bag_reader import message_types
from gcl_ros.conversions import fill_point_cloud2, fill_transform

TYPES = message_types()
M = TYPES.types


def header(stamp, frame):
    time = M['builtin_interfaces/msg/Time'](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return M['std_msgs/msg/Header'](stamp=time, frame_id=frame)


def transform(stamp, frame, child, T):
    message = M['geometry_msgs/msg/Transform'](
        translation=M['geometry_msgs/msg/Vector3'](x=0.0, y=0.0, z=0.0),
        rotation=M['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=0.0, w=1.0),
    )
    return M['geometry_msgs/msg/TransformStamped'](
        header=header(stamp, frame), child_frame_id=child, transform=fill_transform(message, T)
    )


def pose(T):
    x, y, z, w = se3.to_quaternion(T[:3, :3])
    return M['geometry_msgs/msg/Pose'](
        position=M['geometry_msgs/msg/Point'](*(float(v) for v in T[:3, 3])),
        orientation=M['geometry_msgs/msg/Quaternion'](x=x, y=y, z=z, w=w),
    )


def odometry(stamp, T, child='base_link'):
    zero = M['geometry_msgs/msg/Vector3'](x=0.0, y=0.0, z=0.0)
    covariance = np.zeros(36)
    return M['nav_msgs/msg/Odometry'](
        header=header(stamp, 'odom'),
        child_frame_id=child,
        pose=M['geometry_msgs/msg/PoseWithCovariance'](pose=pose(T), covariance=covariance),
        twist=M['geometry_msgs/msg/TwistWithCovariance'](
            twist=M['geometry_msgs/msg/Twist'](linear=zero, angular=zero), covariance=covariance
        ),
    )


def cloud(stamp, points, frame='lidar'):
    message = M['sensor_msgs/msg/PointCloud2'](
        header=header(stamp, frame), height=1, width=0, fields=[], is_bigendian=False,
        point_step=0, row_step=0, data=np.empty(0, np.uint8), is_dense=True,
    )  # fmt: skip
    fill_point_cloud2(message, points, M['sensor_msgs/msg/PointField'])
    message.data = np.frombuffer(message.data, dtype=np.uint8)
    return message


def write(path, messages, storage=StoragePlugin.MCAP):
    """Write (topic, time of writing in nanoseconds, message)."""
    with Writer(path, version=VERSION, storage_plugin=storage) as writer:
        connections = {}
        for topic, written, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            writer.write(connections[topic], written, TYPES.serialize_cdr(message, kind))
    return path
