// The most similar row of another list, and how similar the best of this one is to each of that:
// the compiled twin of `_by_chunks` in gcl_core/matching/nearest.py.
//
// The products of 6 x 4 vectors never leave the registers: only maxima are kept.

#include <algorithm>
#include <limits>
#include <vector>

#include "product.h"

namespace {

constexpr int ROWS = 6;
constexpr float LOWEST = -std::numeric_limits<float>::infinity();

typedef int32_t Places __attribute__((vector_size(4 * LANES)));

// Order in which a block reads: vector of rows, STEP numbers of each. The last row fills it up.
template <class T>
std::vector<T> packed(const T* rows, long n, long depth, long vectors) {
    constexpr long STEP = Product<T>::STEP;
    std::vector<T> out(vectors * depth * LANES);
    for (long v = 0; v < vectors; ++v)
        for (long lane = 0; lane < LANES; ++lane) {
            const T* row = rows + std::min(v * LANES + lane, n - 1) * depth;
            T* to = out.data() + v * depth * LANES + lane * STEP;
            for (long d = 0; d < depth; d += STEP, to += LANES * STEP)
                for (long s = 0; s < STEP; ++s) to[s] = row[d + s];
        }
    return out;
}

// ROWS rows against all others; `best` takes what is larger.
template <class T>
void search(const T* const* a, long depth, const T* b, long vectors, float* value,
            int32_t* column, Vector* best) {
    constexpr long STEP = Product<T>::STEP;
    Vector top[ROWS];
    Places at[ROWS];
    for (int r = 0; r < ROWS; ++r) top[r] = Vector{} + LOWEST, at[r] = Places{};
    for (long v = 0; v < vectors; v += WIDE) {
        Vector sum[ROWS][WIDE] = {};
        for (long d = 0; d < depth; d += STEP)
#pragma GCC unroll 8
            for (int r = 0; r < ROWS; ++r)
#pragma GCC unroll 8
                for (int c = 0; c < WIDE; ++c)
                    Product<T>::add(sum[r][c], a[r] + d, b + ((v + c) * depth + d) * LANES);
#pragma GCC unroll 8
        for (int c = 0; c < WIDE; ++c) {
            Vector most = best[v + c];
            const Places here = Places{} + int32_t(v + c);
#pragma GCC unroll 8
            for (int r = 0; r < ROWS; ++r) {
                most = sum[r][c] > most ? sum[r][c] : most;
                at[r] = sum[r][c] > top[r] ? here : at[r];
                top[r] = sum[r][c] > top[r] ? sum[r][c] : top[r];
            }
            best[v + c] = most;
        }
    }
    for (int r = 0; r < ROWS; ++r) {
        value[r] = LOWEST, column[r] = 0;
        for (long lane = 0; lane < LANES; ++lane) {
            const int32_t where = at[r][lane] * int32_t(LANES) + int32_t(lane);
            if (top[r][lane] > value[r] || (top[r][lane] == value[r] && where < column[r]))
                value[r] = top[r][lane], column[r] = where;
        }
    }
}

// value, column (n): similarity and row of each source row's nearest target row, the first of
// equals. best (m): similarity of each target row's nearest source row. depth: a multiple of STEP.
template <class T>
void nearest(const T* source, long n, const T* target, long m, long depth, float* value,
             int32_t* column, float* best, int threads) {
    const long vectors = (m + LANES * WIDE - 1) / (LANES * WIDE) * WIDE;
    const std::vector<T> b = packed(target, m, depth, vectors);
    std::fill(best, best + m, LOWEST);
#pragma omp parallel num_threads(threads)
    {
        std::vector<float> own(vectors * LANES, LOWEST);
#pragma omp for schedule(static)
        for (long begin = 0; begin < n; begin += ROWS) {
            const T* a[ROWS];
            for (int r = 0; r < ROWS; ++r) a[r] = source + std::min(begin + r, n - 1) * depth;
            float values[ROWS];
            int32_t columns[ROWS];
            search(a, depth, b.data(), vectors, values, columns,
                   reinterpret_cast<Vector*>(own.data()));
            const long count = std::min<long>(ROWS, n - begin);
            std::copy(values, values + count, value + begin);
            for (long r = 0; r < count; ++r)
                column[begin + r] = std::min(columns[r], int32_t(m - 1));
        }
#pragma omp critical
        for (long i = 0; i < m; ++i) best[i] = std::max(best[i], own[i]);
    }
}

}  // namespace

#define INSTANTIATE(T, SUFFIX)                                                                  \
    extern "C" void gcl_nearest_##SUFFIX(const T* source, long n, const T* target, long m,      \
                                         long depth, float* value, int32_t* column, float* best, \
                                         int threads) {                                         \
        nearest(source, n, target, m, depth, value, column, best, threads);                     \
    }

INSTANTIATE(float, f32)
INSTANTIATE(bfloat16, bf16)
