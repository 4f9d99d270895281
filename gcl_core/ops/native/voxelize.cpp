// Points to occupied voxels: the compiled twin of `_grouped` in gcl_core/ops/voxelize.py.
//
// A voxel's place among those between the outermost ones takes some 25 bits, which three passes of
// a radix sort bring into order; points of a voxel keep theirs, so that means are equal to torch's.

#include <cmath>

#include "order.h"

// keys, mean: room for n voxels. Returns how many there are, -1 where torch has to do it: a voxel
// further than `limit` from the origin on an axis, or too many places.
extern "C" int64_t gcl_voxelize(const float* points, int64_t n, float size, float squared_range,
                                int axis_bits, int64_t limit, int64_t* keys, float* mean) {
    if (n >= int64_t(1) << ROW_BITS) return -1;
    std::vector<std::array<int32_t, 4>> cells;  // x, y, z, row
    cells.reserve(n);
    int32_t low[3] = {INT32_MAX, INT32_MAX, INT32_MAX};
    int32_t high[3] = {INT32_MIN, INT32_MIN, INT32_MIN};
    for (int64_t i = 0; i < n; ++i) {
        const float* p = points + 3 * i;
        const float xx = p[0] * p[0], yy = p[1] * p[1], zz = p[2] * p[2];
        if (!(xx + yy + zz <= squared_range)) continue;
        std::array<int32_t, 4> cell;
        for (int axis = 0; axis < 3; ++axis) {
            const float place = std::floor(p[axis] / size);
            if (!(std::fabs(place) <= float(limit))) return -1;
            cell[axis] = int32_t(place);
            low[axis] = std::min(low[axis], cell[axis]);
            high[axis] = std::max(high[axis], cell[axis]);
        }
        cell[3] = int32_t(i);
        cells.push_back(cell);
    }
    if (cells.empty()) return 0;
    int bits[3];
    for (int axis = 0; axis < 3; ++axis) bits[axis] = bits_of(high[axis] - low[axis]);
    const int place_bits = bits[0] + bits[1] + bits[2];
    if (place_bits + ROW_BITS > 64) return -1;
    std::vector<uint64_t> entries(cells.size());
    for (size_t i = 0; i < cells.size(); ++i) {
        uint64_t place = 0;
        for (int axis = 0; axis < 3; ++axis)
            place = place << bits[axis] | uint64_t(cells[i][axis] - low[axis]);
        entries[i] = place << ROW_BITS | i;
    }
    radix_sort(entries, ROW_BITS, ROW_BITS + place_bits);
    int64_t count = 0;
    for (size_t i = 0; i < entries.size(); ++count) {
        const uint64_t place = entries[i] >> ROW_BITS;
        float sum[3] = {0, 0, 0};
        const size_t begin = i;
        const auto& cell = cells[entries[i] & ROW];
        for (; i < entries.size() && entries[i] >> ROW_BITS == place; ++i) {
            const float* p = points + 3 * cells[entries[i] & ROW][3];
            for (int axis = 0; axis < 3; ++axis) sum[axis] += p[axis];
        }
        const int64_t bias = int64_t(1) << (axis_bits - 1);
        keys[count] = (cell[0] + bias) << 2 * axis_bits | (cell[1] + bias) << axis_bits |
                      (cell[2] + bias);
        for (int axis = 0; axis < 3; ++axis) mean[3 * count + axis] = sum[axis] / float(i - begin);
    }
    return count;
}
