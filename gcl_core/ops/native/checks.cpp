// Whether what two scans saw fits together under each of many transforms: the compiled twin of
// `_counted` in gcl_core/estimation/verify.py.
//
// Points are moved a block at a time, in vectors; each is then looked up by itself. A transform
// belongs to one thread, and counts are whole numbers.

#include "directions.h"
#include "grid.h"

namespace {

constexpr double THINNING = 0.02f;  // as in verify.py

// Points axis by axis, filled up to whole blocks.
struct Points {
    Points(const float* rows, int64_t n) : count(n), x(padded(n)), y(x.size()), z(x.size()) {
        for (int64_t i = 0; i < n; ++i)
            x[i] = rows[3 * i], y[i] = rows[3 * i + 1], z[i] = rows[3 * i + 2];
    }
    static int64_t padded(int64_t n) { return (n + BLOCK - 1) / BLOCK * BLOCK; }

    int64_t count;
    std::vector<float> x, y, z;
};

// One axis of a block of moved points; products are exact.
inline void move(const float* row, const Points& points, int64_t begin, float* to) {
    const double a = row[0], b = row[1], c = row[2], d = row[3];
    const float *x = &points.x[begin], *y = &points.y[begin], *z = &points.z[begin];
    for (int i = 0; i < BLOCK; ++i)
        to[i] = float(a * double(x[i]) + b * double(y[i]) + c * double(z[i]) + d);
}

inline int move(const float* T, const Points& points, int64_t begin, Directions& to) {
    move(T, points, begin, to.x);
    move(T + 4, points, begin, to.y);
    move(T + 8, points, begin, to.z);
    return int(std::min<int64_t>(BLOCK, points.count - begin));
}

struct Range {
    float near, far;
};

struct Counts {
    int32_t visible = 0, conflict = 0, touching = 0, close = 0, ground = 0, agree = 0;
};

void check_solid(const float* T, const Points& solid, const Image& image, const Range* ranges,
                 const Grid& grid, const uint8_t* occupied, double tolerance, Counts& to) {
    Directions block;
    int32_t places[BLOCK], seen[BLOCK];
    for (int64_t begin = 0; begin < solid.count; begin += BLOCK) {
        const int count = move(T, solid, begin, block);
        measure(block);
        grid.cells_of(block.x, block.y, block.z, BLOCK, places);
        int visible = 0;
        for (int i = 0; i < count; ++i) {
            const int cell = image.cell(block, i);
            const Range range = ranges[cell < 0 ? 0 : cell];
            const double distance = block.distance[i];
            const double slack = tolerance + THINNING * distance;
            const bool sees = (cell >= 0) & (range.near > 0) & (distance < range.far + slack);
            to.conflict += sees & (distance < range.near - slack);
            seen[visible] = places[i];
            visible += sees;
        }
        to.visible += visible;
        // By itself, and without a branch, so that the processor waits for many at a time.
        for (int i = 0; i < visible; ++i) {
            const int there = seen[i] < 0 ? 0 : occupied_at(occupied, seen[i]);
            to.touching += there & 1;
            to.close += there >> 1;
        }
    }
}

void check_ground(const float* T, const Points& ground, const Grid& grid, const float* height,
                  float tolerance, Counts& to) {
    Directions block;
    int32_t places[BLOCK];
    for (int64_t begin = 0; begin < ground.count; begin += BLOCK) {
        const int count = move(T, ground, begin, block);
        grid.cells_of(block.x, block.y, block.z, BLOCK, places);
        for (int i = 0; i < count; ++i) {
            if (places[i] < 0) continue;
            const float here = height[places[i] / grid.upwards()];
            to.ground += here == here;
            to.agree += std::fabs(block.z[i] - here) < tolerance;
        }
    }
}

}  // namespace

// T: rows of 12 numbers, the upper part of each transform. solid, ground: points of the scan that
// is moved, n x 3 and m x 3; the rest is of the other one. grid is that of `occupied`, ground_grid
// that of `height`. counts: six for each transform, as `Counts`.
extern "C" void gcl_check(const float* T, int64_t transforms, const float* solid, int64_t n,
                          const float* ground, int64_t m, const float* near, const float* far,
                          const float* column_slopes, int columns, const float* row_slopes,
                          int rows, const uint8_t* occupied, const Grid* grid,
                          const float* height, const Grid* ground_grid, double tolerance,
                          int32_t* counts, int threads) {
    const Image image(column_slopes, columns, row_slopes, rows);
    std::vector<Range> ranges(size_t(rows) * columns);
    for (size_t i = 0; i < ranges.size(); ++i) ranges[i] = {near[i], far[i]};
    const Points upright(solid, n), flat(ground, m);
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int64_t h = 0; h < transforms; ++h) {
        Counts found;
        check_solid(T + 12 * h, upright, image, ranges.data(), *grid, occupied, tolerance, found);
        check_ground(T + 12 * h, flat, *ground_grid, height, float(0.5 * tolerance), found);
        const int32_t all[] = {found.visible, found.conflict, found.touching,
                               found.close,   found.ground,   found.agree};
        std::copy_n(all, 6, counts + 6 * h);
    }
}
