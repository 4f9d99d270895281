"""What one scan says of the space around it: surfaces, seen-through space, ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64, UInt8

from gcl_core.matching.keypoints import spread
from gcl_core.ops.ground import height_above_ground
from gcl_core.ops.voxelize import voxelize
from gcl_core.types import PointCloud

SPACING = 0.4  # metres between the points that are checked
SOLID_HEIGHT = 0.5  # metres above the ground: a car's bumper is solid, a kerb is not
GROUND_HEIGHT = 0.25  # metres: below it a point is ground
MAX_RANGE = 80.0  # metres
CHECKED = 2000  # solid points of a scan that are checked, spread in space
AZIMUTH, ELEVATION = math.radians(0.6), math.radians(0.8)  # cell of the range image
LOWEST, HIGHEST = math.radians(-32.0), math.radians(24.0)
CELL = 0.5  # metres, of the occupancy grid
GROUND_CELL = 2.0  # metres
BELOW, ABOVE = -12.0, 18.0  # metres, height of the grids around the sensor


@dataclass(frozen=True)
class Surface:
    """One scan, ready to be checked against another; made once per scan.

    Attributes:
        solid: points above the ground, spread in space, metres, sensor frame.
        ground: points of the ground, likewise.
        near: shortest range around each direction, metres; 0 where no return came back.
        far: longest range around each direction; inf where no return came back.
        occupied: 2 where a cell holds solid points, 1 beside such a cell.
        height: ground height of each cell; nan where none was seen.
    """

    solid: Float[torch.Tensor, 'n 3']
    ground: Float[torch.Tensor, 'm 3']
    near: Float[torch.Tensor, 'elevation azimuth']
    far: Float[torch.Tensor, 'elevation azimuth']
    occupied: UInt8[torch.Tensor, 'x y z']
    height: Float[torch.Tensor, 'x y']


def surface(cloud: PointCloud) -> Surface:
    """Prepare a scan for checks.

    Raises:
        GclError: no point lies within 80 m.
    """
    points = voxelize([cloud], voxel_size=SPACING, max_range=MAX_RANGE).points
    above = height_above_ground(points, torch.zeros(len(points), dtype=torch.long))
    solid, ground = points[above > SOLID_HEIGHT], points[above < GROUND_HEIGHT]
    near, far = _range_image(torch.from_numpy(cloud.points))
    return Surface(
        solid=solid[spread(solid, CHECKED, seed=0)],
        ground=ground[spread(ground, CHECKED // 2, seed=0)],
        near=near,
        far=far,
        occupied=_occupancy(solid),
        height=_ground_grid(ground),
    )


def direction_cell(
    points: Float[torch.Tensor, '*n 3'],
) -> tuple[Int64[torch.Tensor, '*n'], Float[torch.Tensor, '*n'], Bool[torch.Tensor, '*n']]:
    """Flat cell of the range image, range, and whether the direction lies within the image."""
    x, y, z = points.unbind(-1)
    flat = x * x + y * y
    elevation = torch.atan2(z, flat.sqrt())
    columns, rows = round(2 * math.pi / AZIMUTH), round((HIGHEST - LOWEST) / ELEVATION)
    column = ((torch.atan2(y, x) + math.pi) / AZIMUTH).long() % columns
    row = ((elevation - LOWEST) / ELEVATION).floor().long()
    inside = (row >= 0) & (row < rows)
    return row.clamp(0, rows - 1) * columns + column, (flat + z * z).sqrt(), inside


def _range_image(points: Float[torch.Tensor, 'n 3']) -> tuple[torch.Tensor, torch.Tensor]:
    """Shortest and longest range over 3 x 3 cells around each direction."""
    columns, rows = round(2 * math.pi / AZIMUTH), round((HIGHEST - LOWEST) / ELEVATION)
    cell, distance, inside = direction_cell(points)
    cell, distance = cell[inside], distance[inside]
    near = torch.full((rows * columns,), math.inf).scatter_reduce(0, cell, distance, 'amin')
    far = torch.full((rows * columns,), -math.inf).scatter_reduce(0, cell, distance, 'amax')

    def widest(image: torch.Tensor) -> torch.Tensor:
        grid = image.view(1, 1, rows, columns)
        around = torch.cat([grid[..., -1:], grid, grid[..., :1]], 3)
        return torch.nn.functional.max_pool2d(around, 3, 1, (1, 0))[0, 0]

    near, far = -widest(-near), widest(far)
    return torch.where(near.isinf(), 0.0, near), torch.where(far.isinf(), math.inf, far)


def grid_cell(
    points: Float[torch.Tensor, '*n 3'], size: float
) -> tuple[Int64[torch.Tensor, '*n 3'], Bool[torch.Tensor, '*n']]:
    """Cell of a grid of edge `size` around the sensor, and whether it lies within the grid."""
    corner = points.new_tensor([-MAX_RANGE, -MAX_RANGE, BELOW])
    cell = ((points - corner) / size).floor().long()
    limit = torch.tensor(grid_shape(size))
    inside = ((cell >= 0) & (cell < limit)).all(-1)
    return torch.minimum(cell.clamp(min=0), limit - 1), inside


def grid_shape(size: float) -> tuple[int, int, int]:
    """Cells of such a grid along x, y and z."""
    across = math.ceil(2 * MAX_RANGE / size)
    return across, across, math.ceil((ABOVE - BELOW) / size)


def _occupancy(solid: Float[torch.Tensor, 'n 3']) -> UInt8[torch.Tensor, 'x y z']:
    grid = torch.zeros(grid_shape(CELL), dtype=torch.uint8)
    cell, inside = grid_cell(solid, CELL)
    flat = torch.unique((cell[inside] << torch.tensor([20, 10, 0])).sum(1))
    cell = torch.stack([flat >> 20, (flat >> 10) & 1023, flat & 1023], 1)
    limit = torch.tensor(grid.shape) - 1
    for offset in torch.cartesian_prod(*[torch.arange(-1, 2)] * 3):
        x, y, z = torch.minimum((cell + offset).clamp(min=0), limit).unbind(1)
        grid[x, y, z] = 1
    x, y, z = cell.unbind(1)
    grid[x, y, z] = 2
    return grid


def _ground_grid(ground: Float[torch.Tensor, 'n 3']) -> Float[torch.Tensor, 'x y']:
    """Mean height of the ground points of each cell."""
    cell, inside = grid_cell(ground, GROUND_CELL)
    across = grid_shape(GROUND_CELL)[0]
    flat = cell[inside][:, 0] * across + cell[inside][:, 1]
    total = torch.zeros(across * across).index_add_(0, flat, ground[inside][:, 2])
    return (total / torch.bincount(flat, minlength=across * across)).view(across, across)
