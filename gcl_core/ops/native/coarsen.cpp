// Voxels of twice the size: the compiled twin of `halved` and `halving_map` in
// gcl_core/ops/kernel_map.py.

#include <algorithm>

#include "order.h"

// coarse: key of the voxel of twice the size that holds each of n, with room for n more behind;
// on return the different ones, sorted. parent (n): which of them each voxel lies in. Returns how
// many there are, -1 where torch has to do it.
extern "C" int64_t gcl_unique(const int64_t* coarse, int64_t n, int axis_bits, int64_t* unique,
                              int64_t* parent) {
    std::vector<uint64_t> entries;
    if (!sort_rows(coarse, n, axis_bits, entries)) return -1;
    int64_t count = 0;
    for (int64_t i = 0; i < n; ++i) {
        const int64_t row = int64_t(entries[i] & ROW);
        if (i == 0 || entries[i] >> ROW_BITS != entries[i - 1] >> ROW_BITS)
            unique[count++] = coarse[row];
        parent[row] = count - 1;
    }
    return count;
}

// rows (8, m): row of each of a coarse voxel's fine ones, x slowest, z fastest; n where there is
// none. inverse (8, n): the coarse voxel of each fine one at the offset that it lies at, else m.
extern "C" void gcl_halving_map(const int64_t* fine, int64_t n, const int64_t* parent, int64_t m,
                                int axis_bits, int32_t* rows, int32_t* inverse) {
    std::fill(rows, rows + 8 * m, int32_t(n));
    std::fill(inverse, inverse + 8 * n, int32_t(m));
    for (int64_t i = 0; i < n; ++i) {
        const int64_t x = fine[i] >> 2 * axis_bits & 1, y = fine[i] >> axis_bits & 1;
        const int64_t offset = 4 * x + 2 * y + (fine[i] & 1);
        rows[offset * m + parent[i]] = int32_t(i);
        inverse[offset * n + i] = int32_t(parent[i]);
    }
}
