// Influences, sums at kernel points and neighbour maxima: compiled twins of functions in
// gcl_core/ops/kpconv.py and gcl_core/ops/neighbor_max.py.

#include <algorithm>
#include <vector>

#include "product.h"

namespace {

template <class T>
void neighbor_max(const T* x, int64_t n_inputs, int64_t channels, const int32_t* neighbors,
                  int64_t n_outputs, int64_t width, T* out, int32_t* winner, int threads) {
#pragma omp parallel num_threads(threads)
    {
        std::vector<float> best(channels);
        std::vector<int32_t> who(channels);
#pragma omp for schedule(static)
        for (int64_t i = 0; i < n_outputs; ++i) {
            const int32_t* rows = neighbors + i * width;
            for (int64_t c = 0; c < channels; ++c) best[c] = widen(x[rows[0] * channels + c]);
            std::fill(who.begin(), who.end(), rows[0]);
            for (int64_t k = 1; k < width; ++k) {
                const int32_t row = rows[k];
                if (row >= n_inputs) continue;
                const T* from = x + row * channels;
                float* b = best.data();
                int32_t* w = who.data();
                for (int64_t c = 0; c < channels; ++c) {
                    const float value = widen(from[c]);
                    const bool more = value > b[c];
                    b[c] = more ? value : b[c];
                    w[c] = more ? row : w[c];
                }
            }
            for (int64_t c = 0; c < channels; ++c) {
                out[i * channels + c] = x[who[c] * channels + c];
                winner[i * channels + c] = who[c];
            }
        }
    }
}

// The inputs around one output, axis by axis, in whole vectors.
struct Nearby {
    std::vector<float> x, y, z, much;
    std::vector<int32_t> row, who;
    long count = 0;

    explicit Nearby(long width) {
        const long room = (width + LANES - 1) / LANES * LANES + LANES;
        for (auto* axis : {&x, &y, &z, &much}) axis->resize(room);
        row.resize(room);
        who.resize(room);
    }

    void gather(const float* centre, const float* inputs, int64_t n_inputs, const int32_t* rows,
                long width) {
        count = 0;
        for (long place = 0; place < width; ++place) {
            const int32_t j = rows[place];
            if (j >= n_inputs) continue;
            x[count] = inputs[3 * j] - centre[0];
            y[count] = inputs[3 * j + 1] - centre[1];
            z[count] = inputs[3 * j + 2] - centre[2];
            row[count++] = j;
        }
        std::fill_n(x.begin() + count, LANES, 1e9f);  // what fills up is out of everyone's reach
    }

    // Number of inputs within `extent` of a kernel point; if KEEP, their rows in `who` and their
    // influences in `much`, which have room for one vector more than there are.
    template <bool KEEP> long within(float kx, float ky, float kz, float extent) {
        const float reach = extent * extent;
        long found = 0;
        for (long first = 0; first < count; first += LANES) {
            const Vector dx = load(&x[first]) - kx, dy = load(&y[first]) - ky;
            const Vector dz = load(&z[first]) - kz;
            const Vector squared = dx * dx + dy * dy + dz * dz;
#if defined(__AVX512F__)
            const __mmask16 near =
                _mm512_cmp_ps_mask((__m512)squared, _mm512_set1_ps(reach), _CMP_LT_OQ);
            if (KEEP) {
                const Vector influence = 1 - (Vector)_mm512_sqrt_ps((__m512)squared) / extent;
                const __m512i rows = _mm512_loadu_si512(&row[first]);
                _mm512_storeu_ps(&much[found], _mm512_maskz_compress_ps(near, (__m512)influence));
                _mm512_storeu_si512(&who[found], _mm512_maskz_compress_epi32(near, rows));
            }
            found += __builtin_popcount(near);
#else
            for (long lane = 0; lane < LANES; ++lane) {  // without a branch
                if (KEEP) {
                    who[found] = row[first + lane];
                    much[found] = 1 - __builtin_sqrtf(squared[lane]) / extent;
                }
                found += squared[lane] < reach;
            }
#endif
        }
        return found;
    }
};

// sums[0 .. VECTORS) of channels = sum over a row's entries of value * x[column]
template <class T, int VECTORS>
inline void gather_block(const T* x, long channels, const int32_t* column, const float* value,
                         long entries, T* out) {
    Vector sum[VECTORS] = {};
    for (long e = 0; e < entries; ++e) {
        const T* from = x + column[e] * channels;
        for (int v = 0; v < VECTORS; ++v) sum[v] += value[e] * load(from + v * LANES);
    }
    for (int v = 0; v < VECTORS; ++v) store(sum[v], out + v * LANES);
}

template <class T>
void gather(const T* x, long channels, const int64_t* start, int64_t rows, const int32_t* column,
            const float* value, T* out, int threads) {
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int64_t row = 0; row < rows; ++row) {
        const int32_t* who = column + start[row];
        const float* much = value + start[row];
        const long entries = start[row + 1] - start[row];
        T* to = out + row * channels;
        long c = 0;
        for (; c + 4 * LANES <= channels; c += 4 * LANES)
            gather_block<T, 4>(x + c, channels, who, much, entries, to + c);
        for (; c + LANES <= channels; c += LANES)
            gather_block<T, 1>(x + c, channels, who, much, entries, to + c);
        for (; c < channels; ++c) {
            float sum = 0;
            for (long e = 0; e < entries; ++e) sum += much[e] * widen(x[who[e] * channels + c]);
            narrow(sum, to[c]);
        }
    }
}

}  // namespace

// Called twice. First without `column`: start[i * n_kernel + k + 1] becomes the number of entries
// of output i and kernel point k. Then with the running sums of that in `start`: fills in column
// and value. `kernel` is (3, n_kernel).
extern "C" void gcl_influences(const float* outputs, const float* inputs, int64_t n_inputs,
                               const int32_t* neighbors, int64_t n_outputs, int64_t width,
                               const float* kernel, int64_t n_kernel, float extent, int64_t* start,
                               int32_t* column, float* value, int threads) {
    const float *kx = kernel, *ky = kernel + n_kernel, *kz = ky + n_kernel;
#pragma omp parallel num_threads(threads)
    {
        Nearby nearby(width);
#pragma omp for schedule(static)
        for (int64_t i = 0; i < n_outputs; ++i) {
            nearby.gather(outputs + 3 * i, inputs, n_inputs, neighbors + i * width, width);
            int64_t* own = start + i * n_kernel;
            for (int64_t k = 0; k < n_kernel; ++k) {
                if (!column) {
                    own[k + 1] = nearby.within<false>(kx[k], ky[k], kz[k], extent);
                    continue;
                }
                const long found = nearby.within<true>(kx[k], ky[k], kz[k], extent);
                std::copy_n(nearby.who.data(), found, column + own[k]);
                std::copy_n(nearby.much.data(), found, value + own[k]);
            }
        }
    }
}

extern "C" void gcl_neighbor_max_f32(const float* x, int64_t n_inputs, int64_t channels,
                                     const int32_t* neighbors, int64_t n_outputs, int64_t width,
                                     float* out, int32_t* winner, int threads) {
    neighbor_max(x, n_inputs, channels, neighbors, n_outputs, width, out, winner, threads);
}

extern "C" void gcl_neighbor_max_bf16(const bfloat16* x, int64_t n_inputs, int64_t channels,
                                      const int32_t* neighbors, int64_t n_outputs, int64_t width,
                                      bfloat16* out, int32_t* winner, int threads) {
    neighbor_max(x, n_inputs, channels, neighbors, n_outputs, width, out, winner, threads);
}

// Features summed at each kernel point of each output: out[row] of a sparse matrix times x.
extern "C" void gcl_gather_f32(const float* x, int64_t channels, const int64_t* start,
                               int64_t rows, const int32_t* column, const float* value, float* out,
                               int threads) {
    gather(x, channels, start, rows, column, value, out, threads);
}

extern "C" void gcl_gather_bf16(const bfloat16* x, int64_t channels, const int64_t* start,
                                int64_t rows, const int32_t* column, const float* value,
                                bfloat16* out, int threads) {
    gather(x, channels, start, rows, column, value, out, threads);
}

// The same influences from the inputs' side, in the order of the outputs. Called twice. First
// without `value`: next[j * n_kernel + k] becomes the number of entries of input j and kernel point
// k. Then with the running sums of that, where each begins, in `next`, which moves on.
extern "C" void gcl_invert(const int64_t* start, int64_t n_outputs, int64_t n_kernel,
                           const int32_t* column, const float* value, int64_t* next,
                           int32_t* output, float* swapped) {
    for (int64_t i = 0; i < n_outputs; ++i)
        for (int64_t k = 0; k < n_kernel; ++k)
            for (int64_t e = start[i * n_kernel + k]; e < start[i * n_kernel + k + 1]; ++e) {
                const int64_t place = next[column[e] * n_kernel + k]++;
                if (!value) continue;
                output[place] = i;
                swapped[place] = value[e];
            }
}
