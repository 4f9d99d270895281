// Influences and neighbour maxima: compiled twins of functions in gcl_core/ops/kpconv.py and
// gcl_core/ops/neighbor_max.py.

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <vector>

namespace {

typedef uint16_t bfloat16;
constexpr int64_t LANES = 16;  // floats of a vector register, or a multiple

inline float widen(float value) { return value; }
inline float widen(bfloat16 value) {
    uint32_t bits = uint32_t(value) << 16;
    float out;
    std::memcpy(&out, &bits, 4);
    return out;
}

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

}  // namespace

// Called twice. First without `column`: start[i * n_kernel + k + 1] becomes the number of entries
// of output i and kernel point k. Then with the running sums of that in `start`: fills in column
// and value. `kernel` is (3, n_kernel).
extern "C" void gcl_influences(const float* outputs, const float* inputs, int64_t n_inputs,
                               const int32_t* neighbors, int64_t n_outputs, int64_t width,
                               const float* kernel, int64_t n_kernel, float extent, int64_t* start,
                               int32_t* column, float* value, int threads) {
    const float reach = extent * extent;
    const int64_t padded = (n_kernel + LANES - 1) / LANES * LANES;
    std::vector<float> axes(3 * padded, 1e9f);  // what fills up is out of everyone's reach
    for (int axis = 0; axis < 3; ++axis)
        std::copy_n(kernel + axis * n_kernel, n_kernel, axes.data() + axis * padded);
    const float *kx = axes.data(), *ky = kx + padded, *kz = ky + padded;
#pragma omp parallel num_threads(threads)
    {
        std::vector<float> squared(padded);
        std::vector<int32_t> count(padded);
        std::vector<int64_t> next(n_kernel);
#pragma omp for schedule(static)
        for (int64_t i = 0; i < n_outputs; ++i) {
            std::fill(count.begin(), count.end(), 0);
            if (column) std::copy_n(start + i * n_kernel, n_kernel, next.begin());
            for (int64_t place = 0; place < width; ++place) {
                const int32_t j = neighbors[i * width + place];
                if (j >= n_inputs) continue;
                const float x = inputs[3 * j] - outputs[3 * i];
                const float y = inputs[3 * j + 1] - outputs[3 * i + 1];
                const float z = inputs[3 * j + 2] - outputs[3 * i + 2];
                float* s = squared.data();
                int32_t* n = count.data();
                for (int64_t k = 0; k < padded; ++k) {
                    const float dx = x - kx[k], dy = y - ky[k], dz = z - kz[k];
                    s[k] = dx * dx + dy * dy + dz * dz;
                    n[k] += s[k] < reach;
                }
                for (int64_t k = 0; column && k < n_kernel; ++k) {
                    if (s[k] >= reach) continue;
                    column[next[k]] = j;
                    value[next[k]] = 1 - __builtin_sqrtf(s[k]) / extent;
                    ++next[k];
                }
            }
            for (int64_t k = 0; !column && k < n_kernel; ++k)
                start[i * n_kernel + k + 1] = count[k];
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
