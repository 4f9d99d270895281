// Neighbour tables by merging sorted lists: the compiled twin of `search` and `invert` in
// gcl_core/ops/kernel_map.py.
//
// Voxels one above the other are a pillar. Sorted pillars stay sorted when an offset along x and y
// is added to all of them, so that one walk through both lists, which does not branch on what it
// finds, gives the pillars that meet at that offset; within them, heights are compared. Nothing is
// hashed. Every column of a kernel belongs to one thread.

#include <algorithm>
#include <cstdint>
#include <vector>

namespace {

struct Pillars {
    std::vector<int64_t> place;  // key of a voxel without its height
    std::vector<int32_t> begin;  // row of the first voxel; the last number is that of all voxels

    Pillars(const int64_t* keys, int64_t n, int axis_bits) {
        place.reserve(n);
        begin.reserve(n + 1);
        for (int64_t i = 0; i < n; ++i)
            if (place.empty() || keys[i] >> axis_bits != place.back()) {
                place.push_back(keys[i] >> axis_bits);
                begin.push_back(int32_t(i));
            }
        begin.push_back(int32_t(n));
    }
};

struct Meeting {
    int32_t centres, keys;  // numbers of two pillars
};

// Pillars that meet at an offset; returns how many do. `found` has room for all, and one more.
int64_t meet(const Pillars& centres, const Pillars& keys, int64_t offset, Meeting* found) {
    const int64_t n = int64_t(centres.place.size()), m = int64_t(keys.place.size());
    int64_t count = 0;
    for (int64_t i = 0, j = 0; i < n && j < m;) {
        const int64_t a = centres.place[i] + offset, b = keys.place[j];
        found[count] = {int32_t(i), int32_t(j)};
        count += a == b;
        i += a <= b;
        j += b <= a;
    }
    return count;
}

// A column of a kernel: `to[dz * to_step + centre] = row`, and `back[dz * back_step + row] =
// centre` unless it is null, for every voxel `lowest + dz` from a centre, dz < height.
struct Column {
    int64_t lowest;
    int height;
    int32_t* to;
    int64_t to_step;
    int32_t* back;
    int64_t back_step;

    inline void note(int64_t dz, int32_t centre, int32_t row) const {
        to[dz * to_step + centre] = row;
        if (back) back[dz * back_step + row] = centre;
    }
};

void compare(const int64_t* centres, int32_t centre, int32_t centres_end, const int64_t* keys,
             int32_t row, int32_t rows_end, const Column& column) {
    if (centres_end - centre == 1 && rows_end - row == 1) {  // three of four times
        const int64_t dz = keys[row] - centres[centre] - column.lowest;
        if (dz >= 0 && dz < column.height) column.note(dz, centre, row);
        return;
    }
    for (; centre < centres_end; ++centre) {
        const int64_t first = centres[centre] + column.lowest;
        while (row < rows_end && keys[row] < first) ++row;
        for (int32_t next = row; next < rows_end && keys[next] < first + column.height; ++next)
            column.note(keys[next] - first, centre, next);
    }
}

struct Kernel {
    int edge, height, axis_bits;

    int columns() const { return edge * edge; }
    int64_t offset(int column) const {  // of pillars
        const int64_t dx = column / edge - edge / 2, dy = column % edge - edge / 2;
        return dx * (int64_t(1) << axis_bits) + dy;
    }
    int64_t lowest(int column) const {  // of voxels
        return offset(column) * (int64_t(1) << axis_bits) - height / 2;
    }
};

}  // namespace

// rows (kernel^2 x height, n_centres): row of `keys` at each offset of each centre, n_keys where
// none.  inverse (kernel^2 x height, n_keys), may be null: the same pairs from the other side.
extern "C" void gcl_search(const int64_t* keys, int64_t n_keys, const int64_t* centres,
                           int64_t n_centres, int edge, int height, int axis_bits, int32_t* rows,
                           int32_t* inverse, int threads) {
    const Kernel kernel{edge, height, axis_bits};
    const Pillars of_keys(keys, n_keys, axis_bits), of_centres(centres, n_centres, axis_bits);
#pragma omp parallel num_threads(threads)
    {
        std::vector<Meeting> met(std::min(n_keys, n_centres) + 1);
#pragma omp for schedule(static)
        for (int c = 0; c < kernel.columns(); ++c) {
            int32_t* to = rows + c * height * n_centres;
            int32_t* back = inverse ? inverse + c * height * n_keys : nullptr;
            std::fill(to, to + height * n_centres, int32_t(n_keys));
            if (back) std::fill(back, back + height * n_keys, int32_t(n_centres));
            const Column column{kernel.lowest(c), height, to, n_centres, back, n_keys};
            const int64_t count = meet(of_centres, of_keys, kernel.offset(c), met.data());
            for (int64_t i = 0; i < count; ++i) {
                const int32_t *a = &of_centres.begin[met[i].centres], *b = &of_keys.begin[met[i].keys];
                compare(centres, a[0], a[1], keys, b[0], b[1], column);
            }
        }
    }
}

// As gcl_search around the keys themselves, edge and height odd: what a voxel finds at an offset
// finds it at the opposite one, so that half of the kernel is searched.
extern "C" void gcl_search_same(const int64_t* keys, int64_t n, int edge, int height,
                                int axis_bits, int32_t* rows, int threads) {
    const Kernel kernel{edge, height, axis_bits};
    const Pillars pillars(keys, n, axis_bits);
    const int64_t size = height * n;  // of a column's table
#pragma omp parallel num_threads(threads)
    {
        std::vector<Meeting> met(n + 1);
#pragma omp for schedule(static)
        for (int c = 0; c <= kernel.columns() / 2; ++c) {
            int32_t *to = rows + c * size, *opposite = rows + (kernel.columns() - 1 - c) * size;
            std::fill(to, to + size, int32_t(n));
            if (opposite != to) std::fill(opposite, opposite + size, int32_t(n));
            const Column column{kernel.lowest(c), height, to, n, opposite + size - n, -n};
            const int64_t count = meet(pillars, pillars, kernel.offset(c), met.data());
            for (int64_t i = 0; i < count; ++i) {
                const int32_t *a = &pillars.begin[met[i].centres], *b = &pillars.begin[met[i].keys];
                compare(keys, a[0], a[1], keys, b[0], b[1], column);
            }
        }
    }
}
