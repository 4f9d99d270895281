"""What one scan says of the space around it: surfaces, seen-through space, ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64, UInt8

from gcl_core.matching.keypoints import spread
from gcl_core.ops.ground import height_above_ground
from gcl_core.ops.native.grids import grid_numbers, mean_heights, occupancy
from gcl_core.ops.native.range_image import range_image
from gcl_core.ops.voxelize import voxelize
from gcl_core.types import PointCloud

SPACING = 0.4  # metres between the points that are checked
SOLID_HEIGHT = 0.5  # metres above the ground: a car's bumper is solid, a kerb is not
GROUND_HEIGHT = 0.25  # metres: below it a point is ground
MAX_RANGE = 80.0  # metres
CHECKED = 2000  # solid points of a scan that are checked, spread in space
AZIMUTH, ELEVATION = math.radians(0.6), math.radians(0.8)  # cell of the range image
LOWEST, HIGHEST = math.radians(-32.0), math.radians(24.0)
ROWS, COLUMNS = round((HIGHEST - LOWEST) / ELEVATION), round(2 * math.pi / AZIMUTH)
# Borders of cells as slopes, so that a quotient and comparisons tell a cell: the same on every
# machine, which an arc tangent is not. Columns are told by eighths of a turn.
COLUMN_SLOPES = torch.tensor([math.tan(AZIMUTH * (i + 1)) for i in range(COLUMNS // 8)])
ROW_SLOPES = torch.tensor([math.tan(LOWEST + ELEVATION * i) for i in range(ROWS + 1)])
LEAST = 1e-30  # metres: a divisor instead of 0
CELL = 0.5  # metres, of the occupancy grid
GROUND_CELL = 2.0  # metres
BELOW, ABOVE = -12.0, 18.0  # metres, height of the grids around the sensor
LOW = (-MAX_RANGE, -MAX_RANGE, BELOW)  # corner of the grids


@dataclass(frozen=True)
class Surface:
    """One scan, ready to be checked against another; made once per scan.

    Attributes:
        solid: points above the ground, spread in space, metres, sensor frame.
        ground: points of the ground, likewise.
        near: shortest range around each direction, metres; 0 where no return came back.
        far: longest range around each direction; inf where no return came back.
        occupied: two bits for each cell (see `grid_cell`), four cells in a byte: the first is set
            where it or one beside it holds solid points, the second where it does itself.
        height: ground height of each column of cells; nan where none was seen.
    """

    solid: Float[torch.Tensor, 'n 3']
    ground: Float[torch.Tensor, 'm 3']
    near: Float[torch.Tensor, 'elevation azimuth']
    far: Float[torch.Tensor, 'elevation azimuth']
    occupied: UInt8[torch.Tensor, ' quarter']
    height: Float[torch.Tensor, ' columns']


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
        solid=solid[spread(solid, CHECKED)],
        ground=ground[spread(ground, CHECKED // 2)],
        near=near,
        far=far,
        occupied=_occupancy(solid),
        height=_ground_grid(ground),
    )


def direction_cell(
    points: Float[torch.Tensor, '*h 3 n'],
) -> tuple[Int64[torch.Tensor, '*h n'], Float[torch.Tensor, '*h n'], Bool[torch.Tensor, '*h n']]:
    """Flat cell of the range image, range, and whether the direction lies within the image."""
    x, y, z = points.unbind(-2)
    flat = x.double().square() + y.double().square()  # products are exact: rounded once
    rise = z / flat.sqrt().float().clamp(min=LEAST)
    row = torch.bucketize(rise, ROW_SLOPES, right=True) - 1
    inside = (row >= 0) & (row < ROWS)
    cell = row.clamp_(0, ROWS - 1).mul_(COLUMNS).add_(_column(x, y))
    return cell, (flat + z.double().square()).sqrt_().float(), inside


def _column(
    x: Float[torch.Tensor, '*h n'], y: Float[torch.Tensor, '*h n']
) -> Int64[torch.Tensor, '*h n']:
    """Column of the range image; the first is straight behind, to the right."""
    across, along = y.abs(), x.abs()
    slope = torch.minimum(across, along) / torch.maximum(across, along).clamp(min=LEAST)
    steps = torch.bucketize(slope, COLUMN_SLOPES, right=True)  # from the nearer axis
    steps = torch.where(across > along, COLUMNS // 4 - 1 - steps, steps)  # from the x axis
    left = torch.where(x < 0, COLUMNS - 1 - steps, COLUMNS // 2 + steps)
    right = torch.where(x < 0, steps, COLUMNS // 2 - 1 - steps)
    return torch.where(y < 0, right, left)


def _range_image(points: Float[torch.Tensor, 'n 3']) -> tuple[torch.Tensor, torch.Tensor]:
    """Shortest and longest range over 3 x 3 cells around each direction."""
    return range_image(points, COLUMN_SLOPES, ROW_SLOPES) or _image_of(points)


def _image_of(points: Float[torch.Tensor, 'n 3']) -> tuple[torch.Tensor, torch.Tensor]:
    cell, distance, inside = direction_cell(points.t().contiguous())
    # What lies outside goes to a cell of its own.
    cell = torch.where(inside, cell, ROWS * COLUMNS)
    empty = torch.full((ROWS * COLUMNS + 1,), math.inf)
    near = empty.scatter_reduce(0, cell, distance, 'amin')[:-1]
    far = (-empty).scatter_reduce(0, cell, distance, 'amax')[:-1]

    def widest(image: torch.Tensor) -> torch.Tensor:
        grid = image.view(1, 1, ROWS, COLUMNS)
        around = torch.cat([grid[..., -1:], grid, grid[..., :1]], 3)
        return torch.nn.functional.max_pool2d(around, 3, 1, (1, 0))[0, 0]

    near, far = -widest(-near), widest(far)
    return torch.where(near.isinf(), 0.0, near), torch.where(far.isinf(), math.inf, far)


def grid_shape(size: float) -> tuple[int, int, int]:
    """Cells along x, y and z of a grid of edge `size` around the sensor, the margin included."""
    across = math.ceil(2 * MAX_RANGE / size) + 2
    return across, across, math.ceil((ABOVE - BELOW) / size) + 2


def grid_cell(
    points: Float[torch.Tensor, '*h 3 n'], size: float
) -> tuple[Int64[torch.Tensor, '*h n'], Bool[torch.Tensor, '*h n']]:
    """Flat cell of such a grid, and whether it lies within the margin; cell 0 if it does not."""
    shape = grid_shape(size)
    flat, inside = torch.zeros(1), torch.ones(1, dtype=torch.bool)
    for row, low, cells in zip(points.unbind(-2), LOW, shape):
        place = ((row - low) / size).floor_() + 1
        inside = inside & (place > 0) & (place < cells - 1)
        flat = flat * cells + place  # exact: float32 counts to 16 million
    return torch.where(inside, flat, 0.0).long(), inside


def neighbors(size: float) -> Int64[torch.Tensor, '27 4']:
    """Offsets of the cells around one: x, y, z, and what to add to a flat cell."""
    shape = grid_shape(size)
    offsets = torch.cartesian_prod(*[torch.arange(-1, 2)] * 3)
    flat = (offsets * torch.tensor([shape[1] * shape[2], shape[2], 1])).sum(1, keepdim=True)
    return torch.cat([offsets, flat], 1)


def numbers_of_grid(size: float) -> Float[torch.Tensor, ' 7']:
    """Such a grid for compiled functions."""
    return grid_numbers(LOW, size, grid_shape(size))


def _occupancy(solid: Float[torch.Tensor, 'n 3']) -> UInt8[torch.Tensor, ' quarter']:
    found = occupancy(solid, numbers_of_grid(CELL))
    return _occupied_by(solid) if found is None else found


def _occupied_by(solid: Float[torch.Tensor, 'n 3']) -> UInt8[torch.Tensor, ' quarter']:
    cells = math.prod(grid_shape(CELL))
    grid = torch.zeros(cells + -cells % 4, dtype=torch.uint8)
    cell, inside = grid_cell(solid.t(), CELL)
    cell = cell[inside].unique()
    grid[(cell[:, None] + neighbors(CELL)[:, 3]).flatten()] = 1
    grid[cell] = 3
    first, second, third, fourth = grid.view(-1, 4).unbind(1)
    return first | second << 2 | third << 4 | fourth << 6


def occupied_at(
    occupied: UInt8[torch.Tensor, ' quarter'], cell: Int64[torch.Tensor, '*h n']
) -> UInt8[torch.Tensor, '*h n']:
    """The two bits of each cell, see `Surface`."""
    return occupied[cell >> 2] >> ((cell & 3) << 1).to(torch.uint8) & 3


def _ground_grid(ground: Float[torch.Tensor, 'n 3']) -> Float[torch.Tensor, ' columns']:
    """Mean height of the ground points of each column of cells."""
    found = mean_heights(ground, numbers_of_grid(GROUND_CELL))
    return _mean_heights(ground) if found is None else found


def _mean_heights(ground: Float[torch.Tensor, 'n 3']) -> Float[torch.Tensor, ' columns']:
    across, _, upwards = grid_shape(GROUND_CELL)
    cell, inside = grid_cell(ground.t(), GROUND_CELL)
    column, columns = cell[inside] // upwards, across * across
    total = torch.zeros(columns).index_add_(0, column, ground[inside][:, 2])
    return total / torch.bincount(column, minlength=columns)
