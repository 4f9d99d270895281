// How much of the correspondences each of many transforms explains: the compiled twin of
// `_by_blocks` in gcl_core/estimation/support.py.
//
// Residuals never leave the registers. A transform belongs to one thread, which adds up its
// inliers in one order, so that results do not depend on the number of threads.

#include <algorithm>

#include "product.h"

namespace {

constexpr int TOGETHER = 4;  // transforms: each correspondence is loaded once for all of them

// T: rows of 12 numbers, the upper part of each transform. table: seven rows of `count` numbers,
// a multiple of LANES: source x y z, target x y z, weight.
void scores(const float* const* T, const float* table, long count, float limit, float* to) {
    Vector sum[TOGETHER] = {};
    for (long i = 0; i < count; i += LANES) {
        Vector at[7];
#pragma GCC unroll 8
        for (int row = 0; row < 7; ++row) at[row] = load(table + row * count + i);
#pragma GCC unroll 8
        for (int h = 0; h < TOGETHER; ++h) {
            Vector squared = {};
#pragma GCC unroll 8
            for (int axis = 0; axis < 3; ++axis) {
                const float* r = T[h] + 4 * axis;
                const Vector off = r[0] * at[0] + r[1] * at[1] + r[2] * at[2] + (r[3] - at[3 + axis]);
                squared += off * off;
            }
            sum[h] += squared < limit ? at[6] : Vector{};
        }
    }
    for (int h = 0; h < TOGETHER; ++h) {
        to[h] = 0;
        for (long lane = 0; lane < LANES; ++lane) to[h] += sum[h][lane];
    }
}

}  // namespace

extern "C" void gcl_support(const float* T, int64_t transforms, const float* table, int64_t count,
                            float limit, float* to, int threads) {
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int64_t begin = 0; begin < transforms; begin += TOGETHER) {
        const float* rows[TOGETHER];
        float found[TOGETHER];
        for (int h = 0; h < TOGETHER; ++h) rows[h] = T + 12 * std::min(begin + h, transforms - 1);
        scores(rows, table, count, limit, found);
        std::copy_n(found, std::min<int64_t>(TOGETHER, transforms - begin), to + begin);
    }
}
