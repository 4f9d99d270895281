"""Features of a scan as a PointCloud2: what one vehicle sends to another instead of its points.

Format, version 2. A row (`height`) for each heading that the scan was described at. As many key
points in each row (`width`). A point has 40 bytes:

    x, y, z     INT16          position in the sensor's frame, in 1/256 m
    turn        INT16          by which the scan was turned about z before it was described, in
                               1/32768 of half a turn; the same for the whole row
    gcl2_HASH   INT8 x 32      descriptor, of unit length when divided by 127

The name of the last field tells the format's version and the weights that described the scan, by
the first 12 digits of a SHA-256 of their values: descriptors of different weights do not match.
1,000 key points at one heading are 40,000 bytes.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.matching.keypoints import selected
from gcl_core.models.backbone import Backbone
from gcl_core.types import Features, PointCloud
from gcl_ros.conversions import check_size, column

VERSION = 2
UNIT = 256  # of a metre; int16 reaches 128 m
SCALE = 127  # of a descriptor
HALF_TURN = 32768
_INT8, _INT16 = 1, 3  # sensor_msgs/PointField datatypes
SHORT = ('x', 'y', 'z', 'turn')
_NAME = re.compile(r'gcl(\d+)_(\w+)')


def weights_hash(model: Backbone[Any, Any]) -> str:
    """First 12 digits of the SHA-256 of a network's shape and values."""
    digest = hashlib.sha256(json.dumps(asdict(model.config), sort_keys=True).encode())
    for name, tensor in sorted(model.state_dict().items()):
        digest.update(name.encode())
        digest.update(tensor.detach().contiguous().numpy().tobytes())
    return digest.hexdigest()[:12]


def is_feature_cloud(message: Any) -> bool:
    """Whether a PointCloud2 carries features, of whatever version."""
    return any(_NAME.fullmatch(field.name) for field in message.fields)


@dataclass(frozen=True)
class Described:
    """A scan described at one or more headings.

    Attributes:
        headings: features in the frames turned by `yaws`.
        yaws: of T_turned_lidar, radians.
    """

    headings: list[Features]
    yaws: list[float]


def describe(model: Backbone[Any, Any], cloud: PointCloud, turns: int) -> Described:
    """Describe a scan at evenly spaced headings, the first along its street."""
    first = se3.yaw(model.facing(cloud))
    yaws = [first + 2 * np.pi * k / turns for k in range(turns)]
    return Described(model.describe_turned(cloud, yaws), yaws)


def fill_feature_cloud(
    message: Any, described: Described, weights: str, limit: int, field_type: Any
) -> Any:
    """Fill an empty PointCloud2 with features; returns it.

    Args:
        message: sensor_msgs/PointCloud2.
        described: the scan.
        weights: `weights_hash` of what described them.
        limit: most key points of a heading; fewer if a heading has fewer.
        field_type: sensor_msgs/PointField.
    """
    headings = described.headings
    width = min(limit, *(len(features) for features in headings))
    length = headings[0].descriptors.shape[1]
    layout = np.dtype([('position', '<i2', 3), ('turn', '<i2'), ('descriptor', 'i1', length)])
    cells = np.zeros((len(headings), width), layout)
    for row, (features, yaw) in enumerate(zip(headings, described.yaws, strict=True)):
        chosen = selected(features, width)
        points = se3.transform(se3.from_xyz_rpy(yaw=-yaw), chosen.points.double().numpy())
        turn = round(yaw / np.pi * HALF_TURN)
        cells[row]['turn'] = (turn + HALF_TURN) % (2 * HALF_TURN) - HALF_TURN
        cells[row]['position'] = np.clip(np.rint(points * UNIT), -32768, 32767)
        cells[row]['descriptor'] = np.rint(chosen.descriptors.float().numpy() * SCALE)
    message.height, message.width = cells.shape
    message.fields = [
        *(field_type(name=a, offset=2 * i, datatype=_INT16, count=1) for i, a in enumerate(SHORT)),
        field_type(name=f'gcl{VERSION}_{weights}', offset=8, datatype=_INT8, count=length),
    ]
    message.is_bigendian, message.is_dense = False, True
    message.point_step, message.row_step = layout.itemsize, layout.itemsize * width
    message.data = cells.tobytes()
    return message


def feature_cloud(message: Any, weights: str, length: int = 32) -> Described:
    """Read a feature cloud.

    Args:
        message: sensor_msgs/PointCloud2.
        weights: `weights_hash` of the reader's network.
        length: of its descriptors.

    Raises:
        GclError: another version, other weights, or not as the format says.
    """
    name = f'feature cloud in frame {message.header.frame_id!r}'
    fields = {field.name: field for field in message.fields}
    descriptor = _descriptor_field(fields, name, weights)
    check_size(message, name)
    expected = dict.fromkeys(SHORT, (_INT16, 1))
    expected[descriptor] = (_INT8, length)
    for key, (datatype, count) in expected.items():
        field = fields.get(key)
        if field is None or (field.datatype, max(field.count, 1)) != (datatype, count):
            raise GclError(f'{name}: field {key!r} is missing or not as format {VERSION} says')
    positions = np.stack([column(message, fields[a], name) for a in 'xyz'], axis=2) / UNIT
    values = column(message, fields[descriptor], name).astype(np.float32)
    norms = np.linalg.norm(values, axis=2, keepdims=True)
    if not norms.all():
        raise GclError(f'{name}: a descriptor is zero')
    yaws = column(message, fields['turn'], name)[:, 0] * (np.pi / HALF_TURN)
    headings = [
        Features(
            torch.from_numpy(se3.transform(se3.from_xyz_rpy(yaw=yaw), points).astype(np.float32)),
            torch.from_numpy(vectors / norm),
        )
        for yaw, points, vectors, norm in zip(yaws, positions, values, norms, strict=True)
    ]
    return Described(headings, yaws.tolist())


def _descriptor_field(fields: dict[str, Any], name: str, weights: str) -> str:
    """Name of the descriptors' field, if it is of this version and these weights."""
    key = next((key for key in fields if _NAME.fullmatch(key)), '')
    match = _NAME.fullmatch(key)
    if match is None:
        raise GclError(f'{name} has no field of features; it has {", ".join(fields) or "none"}')
    version, theirs = match.groups()
    if version != str(VERSION):
        raise GclError(
            f'{name} has format {version}, this node reads {VERSION}: run the same release of '
            'gcl_ros on both vehicles'
        )
    if theirs != weights:
        raise GclError(
            f'{name} was described by the weights {theirs}, this node has {weights}: set the same '
            'weights on both vehicles'
        )
    return key
