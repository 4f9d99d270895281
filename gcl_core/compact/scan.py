"""A scan to bytes and back.

Bytes begin with a header of 32, little endian:

    4s  b'GCLS'
    u8  format version, 1
    u8  residual bits an axis
    u8  depth of the octree
    u8  0
    f32 voxel size, metres
    i32 x, y, z of the first voxel, in voxels from the sensor
    u32 number of voxels
    u32 CRC-32 of everything else

Then the residuals, packed: for each voxel in the order of its key (x, y, z) the place of its
points' mean within it, x, y and z, in 2^bits steps. Then the octree, see `octree`.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int64

from gcl_core.compact import octree
from gcl_core.compact.priors import priors
from gcl_core.errors import GclError
from gcl_core.ops.voxelize import BIAS, voxelize
from gcl_core.types import PointCloud

MAGIC, VERSION = b'GCLS', 1
HEADER = struct.Struct('<4sBBBxfiiiI')
CHECKSUM = struct.Struct('<I')
SIZE = HEADER.size + CHECKSUM.size
MOST_VOXELS = 1_000_000  # a scan of 300,000 points has fewer; what a decoder takes memory for
MOST_RESIDUAL_BITS = 8


@dataclass(frozen=True)
class CompactConfig:
    """How much of a scan is kept.

    Attributes:
        voxel_size: edge of a voxel, metres; of each occupied one its centre comes back.
        max_range: points farther from the sensor are left out, metres.
        residual_bits: bits an axis for the mean of a voxel's points within it; 0 for its centre.
            Each costs 3 bits a voxel.
    """

    voxel_size: float = 0.25
    max_range: float = 100.0
    residual_bits: int = 0

    def __post_init__(self) -> None:
        if not 0.01 <= self.voxel_size <= 10:
            raise GclError(f'voxel_size is {self.voxel_size:g} m; choose 0.01 to 10')
        if not 1 <= self.max_range <= 1000:
            raise GclError(f'max_range is {self.max_range:g} m; choose 1 to 1000')
        if not 0 <= self.residual_bits <= MOST_RESIDUAL_BITS:
            raise GclError(
                f'residual_bits is {self.residual_bits}; choose 0 to {MOST_RESIDUAL_BITS}'
            )


@dataclass(frozen=True)
class Header:
    """What the first bytes of a compact scan say.

    Attributes:
        residual_bits: an axis.
        depth: of the octree.
        voxel_size: metres.
        first: x, y and z of the voxel that coordinates count from, in voxels from the sensor.
        count: number of voxels.
    """

    residual_bits: int
    depth: int
    voxel_size: float
    first: tuple[int, int, int]
    count: int

    def pack(self) -> bytes:
        """All but the checksum."""
        return HEADER.pack(
            *(MAGIC, VERSION, self.residual_bits, self.depth),
            *(self.voxel_size, *self.first, self.count),
        )


def encode(cloud: PointCloud, config: CompactConfig | None = None) -> bytes:
    """Write a scan.

    Args:
        cloud: in its sensor's frame.
        config: how much is kept.

    Raises:
        GclError: no point lies within `max_range`, or voxels are too small for it.
    """
    config = config or CompactConfig()
    keys, depth, first, means = occupied(cloud, config)
    head = Header(config.residual_bits, depth, config.voxel_size, first, len(keys)).pack()
    residuals = _residuals(means, _unpacked(keys) + np.array(first), config)
    body = residuals + octree.encode(keys, depth, priors())
    return head + CHECKSUM.pack(zlib.crc32(body, zlib.crc32(head))) + body


class Occupied(NamedTuple):
    """Voxels of a scan.

    Attributes:
        keys: sorted, counted from `first`.
        depth: of an octree that holds them.
        first: x, y and z of the voxel that coordinates count from, in voxels from the sensor.
        means: mean of the points of each voxel, metres.
    """

    keys: Int64[np.ndarray, ' n']
    depth: int
    first: tuple[int, int, int]
    means: Float32[np.ndarray, 'n 3']


def occupied(cloud: PointCloud, config: CompactConfig) -> Occupied:
    """Find the occupied voxels of a scan; see `encode`."""
    voxels = voxelize([cloud], voxel_size=config.voxel_size, max_range=config.max_range)
    if len(voxels.keys) > MOST_VOXELS:
        raise GclError(
            f'the scan has {len(voxels.keys)} voxels of {config.voxel_size:g} m, {MOST_VOXELS} '
            'are sent at most; choose larger voxels'
        )
    cells = _unpacked(voxels.keys.numpy()) - BIAS
    first = cells.min(0)
    depth = int((cells - first).max()).bit_length()
    if depth > octree.DEEPEST:
        raise GclError(
            f'the scan is {2**depth * config.voxel_size:g} m wide, too much for voxels of '
            f'{config.voxel_size:g} m; choose a smaller max_range or larger voxels'
        )
    x, y, z = first.tolist()
    return Occupied(_packed(cells - first), depth, (x, y, z), voxels.points.numpy())


def decode(data: bytes, name: str = 'compact scan', most_voxels: int = MOST_VOXELS) -> PointCloud:
    """Read a scan: one point for each of its voxels.

    Memory and time are those of `most_voxels`, whatever the bytes are.

    Args:
        data: from `encode`.
        name: of the file or topic, for errors.
        most_voxels: largest scan that is read.

    Raises:
        GclError: damaged, cut off, of another version, or too large.
    """
    head = read_header(data, name)
    if head.count > most_voxels:
        raise GclError(f'{name} has {head.count} voxels, {most_voxels} are read at most')
    checked = zlib.crc32(data[SIZE:], zlib.crc32(data[: HEADER.size]))
    if CHECKSUM.unpack_from(data, HEADER.size)[0] != checked:
        raise GclError(f'{name} is damaged: its checksum does not fit; send or copy it again')
    residuals = _residual_bytes(head)
    if len(data) < SIZE + residuals:
        raise GclError(f'{name} is cut off: {len(data)} bytes, {SIZE + residuals} needed')
    try:
        keys = octree.decode(data[SIZE + residuals :], head.depth, head.count, priors())
    except GclError as error:
        raise GclError(f'{name} is damaged: {error}') from None
    within = _within(data[SIZE : SIZE + residuals], head)
    points = (_unpacked(keys) + np.array(head.first) + within) * np.float64(head.voxel_size)
    return PointCloud(points.astype(np.float32))


def read_header(data: bytes, name: str = 'compact scan') -> Header:
    """Read the header alone.

    Raises:
        GclError: no compact scan, of another version, or impossible numbers.
    """
    if data[:4] != MAGIC or len(data) < SIZE:
        raise GclError(f'{name} is no compact scan: it does not begin with {MAGIC.decode()}')
    _, version, residual_bits, depth, size, x, y, z, count = HEADER.unpack_from(data)
    if version != VERSION:
        raise GclError(
            f'{name} is a compact scan of format {version}, this version reads {VERSION}; '
            'install the same version of gcl_ros on both vehicles'
        )
    possible = (
        residual_bits <= MOST_RESIDUAL_BITS
        and depth <= octree.DEEPEST
        and 1 <= count <= 8**depth
        and 0.0099 <= size <= 10.1
        and max(abs(x), abs(y), abs(z)) <= BIAS
    )
    if not possible:
        raise GclError(
            f'{name} is damaged: its header says {count} voxels of {size:g} m from '
            f'{(x, y, z)} at depth {depth}, {residual_bits} residual bits'
        )
    return Header(residual_bits, depth, size, (x, y, z), count)


def _packed(cells: Int64[np.ndarray, 'n 3']) -> Int64[np.ndarray, ' n']:
    x, y, z = cells.T
    return np.asarray(x << 2 * octree.AXIS_BITS | y << octree.AXIS_BITS | z)


def _unpacked(keys: Int64[np.ndarray, ' n']) -> Int64[np.ndarray, 'n 3']:
    axes = (
        keys >> 2 * octree.AXIS_BITS,
        keys >> octree.AXIS_BITS & octree.AXIS,
        keys & octree.AXIS,
    )
    return np.stack(axes, 1)


def _residual_bytes(head: Header) -> int:
    return (3 * head.residual_bits * head.count + 7) // 8


def _residuals(
    means: Float32[np.ndarray, 'n 3'], cells: Int64[np.ndarray, 'n 3'], config: CompactConfig
) -> bytes:
    """Where the mean of each voxel lies within it, packed."""
    bits = config.residual_bits
    if bits == 0:
        return b''
    within = means.astype(np.float64) / config.voxel_size - cells
    steps = np.clip(np.floor(within * 2**bits), 0, 2**bits - 1).astype(np.uint8)
    every_bit = np.unpackbits(steps.reshape(-1, 1), axis=1)[:, 8 - bits :]
    return np.packbits(every_bit).tobytes()


def _within(data: bytes, head: Header) -> np.ndarray:
    """Place of each point within its voxel, from 0 to 1 on each axis."""
    bits = head.residual_bits
    if bits == 0:
        return np.array(0.5)
    every_bit = np.unpackbits(np.frombuffer(data, np.uint8), count=3 * bits * head.count)
    steps = every_bit.reshape(-1, bits) @ (1 << np.arange(bits)[::-1])
    return np.asarray((steps.reshape(-1, 3) + 0.5) / 2**bits)
