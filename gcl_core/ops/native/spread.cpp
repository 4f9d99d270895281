// At most so many points, one from each cell in turn: the compiled twin of `_in_turn` in
// gcl_core/matching/keypoints.py.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace {

constexpr int64_t MOST = 1 << 22;  // cells that are counted in

}  // namespace

// order: the rows of `points`, n x 3, as they queue. chosen: n zeros, set to 1 for `limit` rows,
// fewer than n. Returns 0, or -1 where torch has to do it: the points lie too far apart.
extern "C" int gcl_spread(const float* points, const int64_t* order, int64_t n, float size,
                          int64_t limit, uint8_t* chosen) {
    float low[3], high[3];
    for (int axis = 0; axis < 3; ++axis) low[axis] = HUGE_VALF, high[axis] = -HUGE_VALF;
    for (int64_t i = 0; i < 3 * n; ++i) {
        if (!std::isfinite(points[i])) return -1;
        low[i % 3] = std::min(low[i % 3], points[i]);
        high[i % 3] = std::max(high[i % 3], points[i]);
    }
    double cells[3];
    for (int axis = 0; axis < 3; ++axis) {
        low[axis] = std::floor(low[axis] / size);
        cells[axis] = double(std::floor(high[axis] / size)) - low[axis] + 1;
    }
    if (!(cells[0] * cells[1] * cells[2] <= MOST)) return -1;
    std::vector<int32_t> waiting(int64_t(cells[0] * cells[1] * cells[2]));
    std::vector<int32_t> cell(n), turn(n), takers;
    for (int64_t i = 0; i < n; ++i) {
        const float* p = points + 3 * order[i];
        int32_t flat = 0;
        for (int axis = 0; axis < 3; ++axis)
            flat = flat * int32_t(cells[axis]) + int32_t(std::floor(p[axis] / size) - low[axis]);
        cell[i] = flat;
        turn[i] = waiting[flat]++;
        if (turn[i] >= int32_t(takers.size())) takers.push_back(0);
        ++takers[turn[i]];
    }
    int32_t last = 0;  // turn in which not all cells come
    int64_t left = limit;
    for (; takers[last] <= left; ++last) left -= takers[last];
    std::vector<int32_t> coming;  // in the last turn, the first cells
    for (int64_t i = 0; i < n; ++i)
        if (turn[i] == last) coming.push_back(cell[i]);
    std::nth_element(coming.begin(), coming.begin() + left, coming.end());
    const int32_t bound = coming[left];
    for (int64_t i = 0; i < n; ++i)
        chosen[order[i]] = turn[i] < last || (turn[i] == last && cell[i] < bound);
    return 0;
}
