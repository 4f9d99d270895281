// Neighbour tables by merging sorted lists: the compiled twin of `search` in
// gcl_core/ops/kernel_map.py.
//
// Sorted keys stay sorted when an offset is added to all of them, so that one walk through both
// lists finds a whole column of the kernel for every voxel, without a hash table.

#include <cstdint>

// rows (kernel^2 x height, n_centres): row of `keys` at each offset of each centre, n_keys where
// none.  inverse (kernel^2 x height, n_keys), may be null: the same pairs from the other side.
extern "C" void gcl_search(const int64_t* keys, int64_t n_keys, const int64_t* centres,
                           int64_t n_centres, int kernel, int height, int axis_bits,
                           int32_t* rows, int32_t* inverse, int threads) {
    const int half = kernel / 2;
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int column = 0; column < kernel * kernel; ++column) {
        const int64_t dx = column / kernel - half, dy = column % kernel - half;
        const int64_t offset = dx * (int64_t(1) << 2 * axis_bits) + dy * (int64_t(1) << axis_bits);
        int32_t* to = rows + int64_t(column) * height * n_centres;
        int32_t* back = inverse ? inverse + int64_t(column) * height * n_keys : nullptr;
        for (int64_t i = 0; back && i < height * n_keys; ++i) back[i] = int32_t(n_centres);
        int64_t row = 0;
        for (int64_t i = 0; i < n_centres; ++i) {
            const int64_t query = centres[i] + offset - height / 2;
            while (row < n_keys && keys[row] < query) ++row;
            int64_t next = row;
            for (int dz = 0; dz < height; ++dz) {
                const bool hit = next < n_keys && keys[next] == query + dz;
                to[dz * n_centres + i] = int32_t(hit ? next : n_keys);
                if (hit && back) back[dz * n_keys + next] = int32_t(i);
                next += hit;
            }
        }
    }
}
