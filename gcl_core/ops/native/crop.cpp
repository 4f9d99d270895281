// Which points some transforms bring near those of another scan: the compiled twin of
// `Neighborhood` in gcl_core/estimation/crop.py. Products are of float32 numbers in float64, so
// that it does not matter which of them are fused with a sum.

#include <algorithm>
#include <cstdint>
#include <vector>

namespace {

// Cells around the points of a scan, each with whether a point lies in it or beside it.
class Neighborhood {
public:
    Neighborhood(const float* points, int64_t n, float reach) {
        for (int axis = 0; axis < 3; ++axis) {
            float low = points[axis], high = points[axis];
            for (int64_t i = 1; i < n; ++i) {
                low = std::min(low, points[3 * i + axis]);
                high = std::max(high, points[3 * i + axis]);
            }
            low_[axis] = low - 2 * reach;
            start_[axis] = low_[axis] / reach;
            cells_[axis] = int64_t((high - low_[axis]) / reach) + 2;
        }
        near_.assign(cells_[0] * cells_[1] * cells_[2], 0);
        for (int64_t i = 0; i < n; ++i) {
            int64_t at[3];
            for (int axis = 0; axis < 3; ++axis)
                at[axis] = int64_t((points[3 * i + axis] - low_[axis]) / reach);
            for (int64_t x = at[0] - 1; x <= at[0] + 1; ++x)
                for (int64_t y = at[1] - 1; y <= at[1] + 1; ++y) {
                    uint8_t* around = &near_[(x * cells_[1] + y) * cells_[2] + at[2]];
                    around[-1] = around[0] = around[1] = 1;
                }
        }
    }

    // T: 12 numbers, the upper part of a transform, over the reach.
    bool holds(const float* T, const float* point) const {
        int64_t flat = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const float* row = T + 4 * axis;
            const double offset = row[3] - start_[axis];
            const double place = double(row[0]) * double(point[0]) +
                                 double(row[1]) * double(point[1]) +
                                 double(row[2]) * double(point[2]) + offset;
            if (!(place >= 0 && place < double(cells_[axis]))) return false;
            flat = flat * cells_[axis] + int64_t(place);
        }
        return near_[flat];
    }

private:
    float low_[3], start_[3];
    int64_t cells_[3];
    std::vector<uint8_t> near_;
};

}  // namespace

// points: of a scan, n x 3, at least one. others: of another one, m x 3. T: rows of 12 numbers over
// the reach, which bring the others there. near: 1 for each of the others that any brings near.
extern "C" void gcl_near(const float* points, int64_t n, float reach, const float* others,
                         int64_t m, const float* T, int64_t transforms, uint8_t* near) {
    const Neighborhood around(points, n, reach);
    for (int64_t i = 0; i < m; ++i) {
        near[i] = 0;
        for (int64_t h = 0; h < transforms && !near[i]; ++h)
            near[i] = around.holds(T + 12 * h, others + 3 * i);
    }
}
