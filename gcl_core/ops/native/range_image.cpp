// Shortest and longest range around each direction: the compiled twin of `_image_of` in
// gcl_core/estimation/surface.py.

#include "directions.h"

namespace {

constexpr float INFINITE = std::numeric_limits<float>::infinity();

// The larger of each number and its two neighbours; the ends of a ring meet.
void widen(const float* from, long count, float* to, bool ring) {
    for (long i = 1; i + 1 < count; ++i)
        to[i] = std::max(from[i], std::max(from[i - 1], from[i + 1]));
    to[0] = std::max(from[0], from[1]);
    to[count - 1] = std::max(from[count - 1], from[count - 2]);
    if (ring) {
        to[0] = std::max(to[0], from[count - 1]);
        to[count - 1] = std::max(to[count - 1], from[0]);
    }
}

// The largest over 3 x 3 cells, in place.
void widen(std::vector<float>& image, int rows, int columns) {
    std::vector<float> wide(image.size());
    for (int row = 0; row < rows; ++row)
        widen(&image[row * columns], columns, &wide[row * columns], true);
    for (int row = 0; row < rows; ++row) {
        const float* here = &wide[row * columns];
        const float* under = &wide[std::max(row - 1, 0) * columns];
        const float* over = &wide[std::min(row + 1, rows - 1) * columns];
        for (int i = 0; i < columns; ++i)
            image[row * columns + i] = std::max(here[i], std::max(under[i], over[i]));
    }
}

}  // namespace

// points: n x 3. column_slopes: an eighth of `columns`. row_slopes: rows + 1. near, far: the image,
// 0 and infinite where no return came back. At least three columns.
extern "C" void gcl_range_image(const float* points, int64_t n, const float* column_slopes,
                                int columns, const float* row_slopes, int rows, float* near,
                                float* far, int threads) {
    const Image image(column_slopes, columns, row_slopes, rows);
    const long cells = long(rows) * columns;
    // Of negated ranges and of ranges; largest ones do not depend on who takes them first.
    std::vector<float> nearest(cells, -INFINITE), farthest(cells, -INFINITE);
#pragma omp parallel num_threads(threads)
    {
        std::vector<float> own_nearest(cells, -INFINITE), own_farthest(cells, -INFINITE);
        Directions block = {};
#pragma omp for schedule(static)
        for (int64_t begin = 0; begin < n; begin += BLOCK) {
            const int count = int(std::min<int64_t>(BLOCK, n - begin));
            for (int i = 0; i < count; ++i) {
                const float* p = points + 3 * (begin + i);
                block.x[i] = p[0], block.y[i] = p[1], block.z[i] = p[2];
            }
            measure(block);
            for (int i = 0; i < count; ++i) {
                const int cell = image.cell(block, i);
                if (cell < 0) continue;
                own_nearest[cell] = std::max(own_nearest[cell], -block.distance[i]);
                own_farthest[cell] = std::max(own_farthest[cell], block.distance[i]);
            }
        }
#pragma omp critical
        for (long i = 0; i < cells; ++i) {
            nearest[i] = std::max(nearest[i], own_nearest[i]);
            farthest[i] = std::max(farthest[i], own_farthest[i]);
        }
    }
    widen(nearest, rows, columns);
    widen(farthest, rows, columns);
    for (long i = 0; i < cells; ++i) {
        near[i] = nearest[i] == -INFINITE ? 0 : -nearest[i];
        far[i] = farthest[i] == -INFINITE ? INFINITE : farthest[i];
    }
}
