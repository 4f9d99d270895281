// In which cell of a grid around the sensor a point lies: the compiled twin of `grid_cell` in
// gcl_core/estimation/surface.py.

#pragma once

#include <cmath>
#include <cstdint>

namespace {

// Cells of one edge, fewer than 2^24: float32 counts them. The outermost are a margin that belongs
// to no point.
struct Grid {
    float low[3];    // where the cells beside the margin begin, metres
    float size;      // metres
    float cells[3];  // whole numbers; the margin included

    // Flat cells of points; -1 in the margin, beyond it, and of no number.
    void cells_of(const float* x, const float* y, const float* z, int count, int32_t* to) const {
        for (int i = 0; i < count; ++i) {
            const float p = std::floor((x[i] - low[0]) / size) + 1;
            const float q = std::floor((y[i] - low[1]) / size) + 1;
            const float r = std::floor((z[i] - low[2]) / size) + 1;
            const bool inside = (p > 0) & (p < cells[0] - 1) & (q > 0) & (q < cells[1] - 1) &
                                (r > 0) & (r < cells[2] - 1);
            to[i] = int32_t(inside ? (p * cells[1] + q) * cells[2] + r : -1.0f);
        }
    }
    int64_t cell(const float* point) const {
        int32_t found;
        cells_of(point, point + 1, point + 2, 1, &found);
        return found;
    }
    int64_t columns() const { return int64_t(cells[0] * cells[1]); }
    int32_t upwards() const { return int32_t(cells[2]); }
    // What to add to a flat cell to go by so many.
    int64_t step(int64_t x, int64_t y, int64_t z) const {
        return (x * int64_t(cells[1]) + y) * int64_t(cells[2]) + z;
    }
};

// The two bits of a cell, see grids.cpp.
inline int occupied_at(const uint8_t* occupied, int64_t cell) {
    return occupied[cell / 4] >> 2 * (cell % 4) & 3;
}

}  // namespace
