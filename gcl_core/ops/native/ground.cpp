// Height above the local ground: the compiled twin of `_above` in gcl_core/ops/ground.py.

#include <algorithm>
#include <cmath>

#include "order.h"

namespace {

struct Cells {
    std::vector<int64_t> key;   // sorted
    std::vector<float> lowest;  // height of its ground

    // Lowest ground of the 3 x 3 cells around each.
    std::vector<float> lowest_around(int axis_bits) const {
        const int64_t n = int64_t(key.size()), one = int64_t(1) << axis_bits;
        std::vector<float> ground(lowest);
        for (int64_t dx = -1; dx <= 1; ++dx)
            for (int64_t i = 0, j = 0; i < n; ++i) {
                const int64_t first = key[i] + dx * one * one - one;
                while (j < n && key[j] < first) ++j;
                for (int64_t next = j; next < n && key[next] <= first + 2 * one; ++next)
                    ground[i] = std::min(ground[i], lowest[next]);
            }
        return ground;
    }
};

}  // namespace

// points (n, 3), scan (n). ghosts: share of a cell's points that are taken for reflections below
// the ground. Returns 0, or -1 where torch has to do it: a cell farther than `limit` from the
// origin, or too many places.
extern "C" int gcl_height(const float* points, const int64_t* scan, int64_t n, float size,
                          float ghosts, int axis_bits, int64_t limit, float* height) {
    const int64_t bias = int64_t(1) << (axis_bits - 1);
    std::vector<int64_t> keys(n);
    for (int64_t i = 0; i < n; ++i) {
        const float x = std::floor(points[3 * i] / size), y = std::floor(points[3 * i + 1] / size);
        if (!(std::fabs(x) <= float(limit) && std::fabs(y) <= float(limit))) return -1;
        keys[i] = ((scan[i] << axis_bits | (int64_t(x) + bias)) << axis_bits | (int64_t(y) + bias))
                  << axis_bits;
    }
    std::vector<uint64_t> entries;
    if (!sort_rows(keys.data(), n, axis_bits, entries)) return -1;
    Cells cells;
    std::vector<int32_t> cell(n);  // of each row
    std::vector<float> heights(n);
    for (int64_t begin = 0, end = 0; begin < n; begin = end) {
        for (; end < n && entries[end] >> ROW_BITS == entries[begin] >> ROW_BITS; ++end) {
            const int64_t row = int64_t(entries[end] & ROW);
            heights[end] = points[3 * row + 2];
            cell[row] = int32_t(cells.key.size());
        }
        const auto low = heights.begin() + begin + int64_t(float(end - begin) * ghosts);
        std::nth_element(heights.begin() + begin, low, heights.begin() + end);
        cells.key.push_back(keys[entries[begin] & ROW]);
        cells.lowest.push_back(*low);
    }
    const std::vector<float> ground = cells.lowest_around(axis_bits);
    for (int64_t i = 0; i < n; ++i) height[i] = points[3 * i + 2] - ground[cell[i]];
    return 0;
}
