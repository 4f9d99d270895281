// What a scan occupies and where its ground lies: the compiled twins of `_occupied_by` and
// `_mean_heights` in gcl_core/estimation/surface.py.

#include "grid.h"

#include <limits>
#include <vector>

// occupied: zeros, two bits for each cell, four cells in a byte, the first in its lowest bits. The
// first becomes 1 where a point lies and beside such a cell, the second where a point lies.
extern "C" void gcl_occupancy(const float* points, int64_t n, const Grid* grid,
                              uint8_t* occupied) {
    for (int64_t i = 0; i < n; ++i) {
        const int64_t cell = grid->cell(points + 3 * i);
        if (cell < 0 || occupied_at(occupied, cell) & 2) continue;
        for (int x = -1; x <= 1; ++x)
            for (int y = -1; y <= 1; ++y)
                for (int z = -1; z <= 1; ++z) {
                    const int64_t around = cell + grid->step(x, y, z);
                    occupied[around / 4] |= 1 << 2 * (around % 4);
                }
        occupied[cell / 4] |= 2 << 2 * (cell % 4);
    }
}

// height: mean z of the points of each column of cells, nan where none lies.
extern "C" void gcl_mean_heights(const float* points, int64_t n, const Grid* grid,
                                 float* height) {
    const int64_t columns = grid->columns();
    std::vector<int32_t> count(columns);
    for (int64_t column = 0; column < columns; ++column) height[column] = 0;
    for (int64_t i = 0; i < n; ++i) {
        const int64_t cell = grid->cell(points + 3 * i);
        if (cell < 0) continue;
        const int64_t column = cell / grid->upwards();
        height[column] += points[3 * i + 2];
        ++count[column];
    }
    for (int64_t column = 0; column < columns; ++column)
        height[column] = count[column] ? height[column] / float(count[column])
                                       : std::numeric_limits<float>::quiet_NaN();
}
