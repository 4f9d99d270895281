// Points within a radius: the compiled twin of `_by_tree` in gcl_core/ops/neighbors.py.
//
// Both lists are sorted by cells as wide as the radius, z fastest. Around a cell, whatever is near
// enough lies in nine runs of three cells, found once for all queries of the cell.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

namespace {

constexpr int AXIS_BITS = 21;
constexpr int64_t BIAS = int64_t(1) << (AXIS_BITS - 1);
constexpr double SLACK = 1 + 1e-9;  // cells are wider than the radius by more than a rounding

struct Placed {
    int64_t cell;
    int32_t row;
    bool operator<(const Placed& other) const {
        return cell != other.cell ? cell < other.cell : row < other.row;
    }
};

std::vector<Placed> by_cell(const float* points, int64_t n, double width) {
    std::vector<Placed> placed(n);
    for (int64_t i = 0; i < n; ++i) {
        int64_t key = 0;
        for (int axis = 0; axis < 3; ++axis)
            key = (key << AXIS_BITS) | (int64_t(std::floor(points[3 * i + axis] / width)) + BIAS);
        placed[i] = {key, int32_t(i)};
    }
    std::sort(placed.begin(), placed.end());
    return placed;
}

}  // namespace

// rows (n_query, limit): support rows, nearest first, then the lower row; n_support where none.
// counts (n_query): how many there are, also beyond the limit.
extern "C" void gcl_radius(const float* support, int64_t n_support, const float* query,
                           int64_t n_query, double radius, int64_t limit, int32_t* rows,
                           int32_t* counts, int threads) {
    const std::vector<Placed> from = by_cell(support, n_support, radius * SLACK);
    const std::vector<Placed> to = by_cell(query, n_query, radius * SLACK);
    std::vector<int64_t> begins;
    for (int64_t i = 0; i < n_query; ++i)
        if (i == 0 || to[i].cell != to[i - 1].cell) begins.push_back(i);
    begins.push_back(n_query);
#pragma omp parallel num_threads(threads)
    {
        std::vector<int32_t> near;
        std::vector<double> where[3], squared;
        std::vector<uint64_t> found;
#pragma omp for schedule(dynamic, 64)
        for (int64_t group = 0; group < int64_t(begins.size()) - 1; ++group) {
            const int64_t cell = to[begins[group]].cell;
            near.clear();
            for (auto& axis : where) axis.clear();
            for (int64_t dx = -1; dx <= 1; ++dx)
                for (int64_t dy = -1; dy <= 1; ++dy) {
                    const int64_t middle = cell + dx * (int64_t(1) << 2 * AXIS_BITS) +
                                           dy * (int64_t(1) << AXIS_BITS);
                    auto it = std::lower_bound(from.begin(), from.end(), Placed{middle - 1, -1});
                    for (; it != from.end() && it->cell <= middle + 1; ++it) {
                        near.push_back(it->row);
                        for (int axis = 0; axis < 3; ++axis)
                            where[axis].push_back(support[3 * it->row + axis]);
                    }
                }
            const int64_t n_near = near.size();
            squared.resize(n_near);
            for (int64_t place = begins[group]; place < begins[group + 1]; ++place) {
                const int64_t i = to[place].row;
                found.clear();
                const double x = query[3 * i], y = query[3 * i + 1], z = query[3 * i + 2];
                const double *nx = where[0].data(), *ny = where[1].data(), *nz = where[2].data();
                double* s = squared.data();
                for (int64_t k = 0; k < n_near; ++k) {
                    const double dx = nx[k] - x, dy = ny[k] - y, dz = nz[k] - z;
                    s[k] = dx * dx + dy * dy + dz * dz;
                }
                for (int64_t k = 0; k < n_near; ++k) {
                    if (s[k] > radius * radius) continue;
                    const float coarse = float(s[k]);  // its bits sort as it does: not negative
                    uint32_t bits;
                    std::memcpy(&bits, &coarse, 4);
                    found.push_back(uint64_t(bits) << 32 | uint32_t(near[k]));
                }
                const int64_t kept = std::min<int64_t>(limit, found.size());
                std::nth_element(found.begin(), found.begin() + kept, found.end());
                std::sort(found.begin(), found.begin() + kept);
                counts[i] = int32_t(found.size());
                for (int64_t k = 0; k < limit; ++k)
                    rows[i * limit + k] = int32_t(k < kept ? uint32_t(found[k]) : n_support);
            }
        }
    }
}
