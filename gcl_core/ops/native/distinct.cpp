// The first of some transforms that differ from all taken before: the compiled twin of `_taken`
// in gcl_core/estimation/hypothesis.py. Products are of float32 numbers in float64, so that it
// does not matter which of them are fused with a sum.

#include <cstdint>

namespace {

bool apart(const float* a, const float* b, double squared_distance, double least_trace) {
    double squared = 0, trace = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const float off = a[4 * axis + 3] - b[4 * axis + 3];
        squared += double(off) * double(off);
    }
    if (squared > squared_distance) return true;
    for (int axis = 0; axis < 3; ++axis)
        for (int i = 0; i < 3; ++i) trace += double(a[4 * axis + i]) * double(b[4 * axis + i]);
    return trace < least_trace;
}

}  // namespace

// T: rows of 16 numbers. order: rows to look at, n of them. taken: room for `limit` rows. Returns
// how many are taken.
extern "C" int64_t gcl_distinct(const float* T, const int64_t* order, int64_t n,
                                double squared_distance, double least_trace, int64_t limit,
                                int64_t* taken) {
    int64_t count = 0;
    for (int64_t i = 0; i < n && count < limit; ++i) {
        bool fresh = true;
        for (int64_t j = 0; j < count && fresh; ++j)
            fresh = apart(T + 16 * order[i], T + 16 * taken[j], squared_distance, least_trace);
        if (fresh) taken[count++] = order[i];
    }
    return count;
}
