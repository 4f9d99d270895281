// In which cell of a grid around the sensor a point lies: the compiled twin of `grid_cell` in
// gcl_core/estimation/surface.py.

#pragma once

#include <cmath>
#include <cstdint>

namespace {

// Cells of one edge; the outermost are a margin that belongs to no point.
struct Grid {
    float low[3];    // where the cells beside the margin begin, metres
    float size;      // metres
    float cells[3];  // whole numbers; the margin included

    // Flat cell; -1 in the margin, beyond it, and of no number.
    int64_t cell(const float* point) const {
        int64_t flat = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const float place = std::floor((point[axis] - low[axis]) / size) + 1;
            if (!(place > 0 && place < cells[axis] - 1)) return -1;
            flat = flat * int64_t(cells[axis]) + int64_t(place);
        }
        return flat;
    }
    int64_t columns() const { return int64_t(cells[0] * cells[1]); }
    // What to add to a flat cell to go by so many.
    int64_t step(int64_t x, int64_t y, int64_t z) const {
        return (x * int64_t(cells[1]) + y) * int64_t(cells[2]) + z;
    }
};

}  // namespace
