// Sparse convolution on the voxels that exist: the compiled twin of gcl_core/ops/sparse_conv.py.
//
// Output rows are taken in tiles whose float32 sums stay in the second-level cache. For each
// kernel offset the tile's existing pairs are listed, and a register block of 6 pairs x 4 vectors
// reads its input rows where they lie: nothing is gathered, nothing is
// scattered. Every tile (and every offset of the weight's gradient) belongs to one thread, so
// results do not depend on the number of threads.

#include <cstddef>
#include <cstdlib>

#include "product.h"

namespace {

constexpr int PAIRS = 6;                   // rows of a register block
constexpr long TILE_BYTES = 192 * 1024;    // of float32 sums: a share of the second-level cache
constexpr long WEIGHT_GRAD_PAIRS = 256;    // pairs packed at a time: 256 x 128 bf16 are 64 kB

inline long round_up(long value, long to) { return (value + to - 1) / to * to; }
inline long padded_width(long channels) { return round_up(channels, LANES); }

// Vectors of the next register block, where so many columns are left: as many as fit, but of 5
// vectors 3 and then 2, since one alone waits for its own sums.
inline int block_vectors(long columns) {
    const long left = columns / LANES;
    return int(left == WIDE + 1 && WIDE > 2 ? WIDE - 1 : left < WIDE ? left : WIDE);
}

// Memory that a thread keeps from call to call, so that no call pays for page faults.
struct Scratch {
    char* data = nullptr;
    size_t size = 0;
    ~Scratch() { std::free(data); }
    char* get(size_t bytes) {
        if (bytes > size) {
            std::free(data);
            size = round_up(bytes, 4096);
            data = static_cast<char*>(std::aligned_alloc(4096, size));
            if (!data) std::abort();
        }
        return data;
    }
};
thread_local Scratch scratch;

// sums[r][0 .. COLS vectors) += sum over depth of a[r][d] * b[d]
template <class T, int ROWS, int COLS>
inline __attribute__((always_inline)) void block(const T* const* a, long a_step, long depth,
                                                 const T* b, long b_step, float* const* sums) {
    Vector sum[ROWS][COLS];
#pragma GCC unroll 8
    for (int r = 0; r < ROWS; ++r)
#pragma GCC unroll 8
        for (int c = 0; c < COLS; ++c)
            sum[r][c] = *reinterpret_cast<const Vector*>(sums[r] + c * LANES);
    for (long d = 0; d < depth; ++d)
#pragma GCC unroll 8
        for (int r = 0; r < ROWS; ++r)
#pragma GCC unroll 8
            for (int c = 0; c < COLS; ++c)
                Product<T>::add(sum[r][c], a[r] + d * a_step,
                                b + d * b_step + c * LANES * Product<T>::STEP);
#pragma GCC unroll 8
    for (int r = 0; r < ROWS; ++r)
#pragma GCC unroll 8
        for (int c = 0; c < COLS; ++c)
            *reinterpret_cast<Vector*>(sums[r] + c * LANES) = sum[r][c];
}

template <class T, int COLS>
void blocks(int rows, const T* const* a, long a_step, long depth, const T* b, long b_step,
            float* const* sums) {
    switch (rows) {
        case 6: return block<T, 6, COLS>(a, a_step, depth, b, b_step, sums);
        case 5: return block<T, 5, COLS>(a, a_step, depth, b, b_step, sums);
        case 4: return block<T, 4, COLS>(a, a_step, depth, b, b_step, sums);
        case 3: return block<T, 3, COLS>(a, a_step, depth, b, b_step, sums);
        case 2: return block<T, 2, COLS>(a, a_step, depth, b, b_step, sums);
        case 1: return block<T, 1, COLS>(a, a_step, depth, b, b_step, sums);
    }
}

template <class T> using Blocks = decltype(&blocks<T, 1>);

// The register blocks of so many vectors.
template <class T> Blocks<T> blocks_of(int vectors) {
    static_assert(WIDE == 2 || WIDE == 4, "a case for each");
    switch (vectors) {
        case 1: return blocks<T, 1>;
        case 2: return blocks<T, 2>;
        case 3: return blocks<T, WIDE == 4 ? 3 : WIDE>;
        default: return blocks<T, WIDE>;
    }
}

// Lists the pairs (input row, output row) of one offset; returns how many there are. `in` and
// `out` have room for all, and LANES more.
inline long list_pairs(const int32_t* neighbors, long begin, long end, int32_t n_in,
                       int32_t* in, int32_t* out) {
    long count = 0, row = begin;
    for (; row + LANES <= end; row += LANES)
        count += keep_below(neighbors + row, n_in, int32_t(row - begin), in + count, out + count);
    for (; row < end; ++row) {
        in[count] = neighbors[row];
        out[count] = int32_t(row - begin);
        count += neighbors[row] < n_in;
    }
    return count;
}

// Weights in the order that `block` reads them: offset, column block, input channel, column.
template <class T>
void pack(const float* weight, long kernel, long c_in, long c_out, bool transposed, T* packed) {
    constexpr long STEP = Product<T>::STEP;
    const long depth = round_up(c_in, STEP), width = padded_width(c_out);
#pragma omp parallel for
    for (long k = 0; k < kernel; ++k) {
        const float* from = weight + k * c_in * c_out;
        T* to = packed + k * depth * width;
        for (long column = 0; column < width;) {
            const long columns = block_vectors(width - column) * LANES;
            for (long i = 0; i < depth; ++i)
                for (long j = 0; j < columns; ++j) {
                    const long o = column + j;
                    float value = 0;
                    if (i < c_in && o < c_out)
                        value = transposed ? from[o * c_in + i] : from[i * c_out + o];
                    narrow(value, to[(i / STEP * columns + j) * STEP + i % STEP]);
                }
            to += depth * columns;
            column += columns;
        }
    }
}

template <class T>
void convolve_tile(const T* x, long c_in, const int32_t* neighbors, long n_out, long kernel,
                   int32_t n_in, const T* packed, long width, long begin, long end, float* sums,
                   int32_t* in, int32_t* out) {
    constexpr long STEP = Product<T>::STEP;
    for (long k = 0; k < kernel; ++k) {
        const long count = list_pairs(neighbors + k * n_out, begin, end, n_in, in, out);
        const T* panel = packed + k * c_in * width;
        for (long column = 0; column < width;) {
            const int vectors = block_vectors(width - column);
            const long columns = vectors * LANES;
            const Blocks<T> multiply = blocks_of<T>(vectors);
            for (long pair = 0; pair < count; pair += PAIRS) {
                const int rows = int(count - pair < PAIRS ? count - pair : PAIRS);
                const T* a[PAIRS];
                float* to[PAIRS];
                for (int r = 0; r < rows; ++r) {
                    a[r] = x + in[pair + r] * c_in;
                    to[r] = sums + out[pair + r] * width + column;
                }
                multiply(rows, a, STEP, c_in / STEP, panel, columns * STEP, to);
            }
            panel += c_in * columns;
            column += columns;
        }
    }
}

template <class T>
void start_sums(float* sum, long width, long c_out, const float* bias, const T* residual) {
    for (long c = 0; c < c_out; ++c)
        sum[c] = (bias ? bias[c] : 0.f) + (residual ? widen(residual[c]) : 0.f);
    for (long c = c_out; c < width; ++c) sum[c] = 0.f;
}

template <class T> void store(const float* sum, long c_out, bool relu, T* out) {
    for (long c = 0; c < c_out; ++c)
        narrow(relu && sum[c] < 0.f ? 0.f : sum[c], out[c]);
}

// x (n_in, c_in), c_in a multiple of STEP; neighbors (kernel, n_out); bias, residual may be null.
template <class T>
void convolve(const T* x, int32_t n_in, long c_in, const int32_t* neighbors, long n_out,
              long kernel, const T* packed, long c_out, const float* bias, const T* residual,
              bool relu, T* out, int threads) {
    const long width = padded_width(c_out);
    long tiles = round_up(n_out * width * 4, TILE_BYTES) / TILE_BYTES;
    tiles = round_up(tiles > 0 ? tiles : 1, threads);
    const long tile = (n_out + tiles - 1) / tiles;
#pragma omp parallel for schedule(dynamic) num_threads(threads)
    for (long t = 0; t < tiles; ++t) {
        const long begin = t * tile, end = begin + tile < n_out ? begin + tile : n_out;
        if (begin >= end) continue;
        const long sums_bytes = round_up(tile * width * 4, 64);
        char* memory = scratch.get(sums_bytes + 2 * (tile + LANES) * 4);
        float* sums = reinterpret_cast<float*>(memory);
        int32_t* in = reinterpret_cast<int32_t*>(memory + sums_bytes);
        for (long row = begin; row < end; ++row)
            start_sums(sums + (row - begin) * width, width, c_out, bias,
                       residual ? residual + row * c_out : nullptr);
        convolve_tile(x, c_in, neighbors, n_out, kernel, n_in, packed, width, begin, end, sums,
                      in, in + tile + LANES);
        for (long row = begin; row < end; ++row)
            store(sums + (row - begin) * width, c_out, relu, out + row * c_out);
    }
}

// Rows of `from` named by `rows`, as `block` reads them: STEP rows interleaved, zeros after the last.
template <class T>
void gather(const T* from, long channels, const int32_t* rows, long count, long width, T* to) {
    constexpr long STEP = Product<T>::STEP;
    for (long p = 0; p < count; p += STEP, to += STEP * width) {
        const T* row[STEP];
        for (long s = 0; s < STEP; ++s)
            row[s] = from + rows[p + s < count ? p + s : p] * channels;
        for (long c = 0; c < channels; ++c)
            for (long s = 0; s < STEP; ++s)
                to[STEP * c + s] = p + s < count ? row[s][c] : T(0);
        std::memset(to + STEP * channels, 0, STEP * (width - channels) * sizeof(T));
    }
}

template <class T>
void weight_grad_block(const T* a, long a_width, const T* g, long g_width, long depth, long c_in,
                       float* sums) {
    constexpr long STEP = Product<T>::STEP;
    for (long column = 0; column < g_width;) {
        const int vectors = block_vectors(g_width - column);
        const Blocks<T> multiply = blocks_of<T>(vectors);
        for (long i = 0; i < c_in; i += PAIRS) {
            const int rows = int(c_in - i < PAIRS ? c_in - i : PAIRS);
            const T* from[PAIRS];
            float* to[PAIRS];
            for (int r = 0; r < rows; ++r) {
                from[r] = a + (i + r) * STEP;
                to[r] = sums + (i + r) * g_width + column;
            }
            multiply(rows, from, a_width * STEP, depth, g + column * STEP, g_width * STEP, to);
        }
        column += vectors * LANES;
    }
}

// grad_weight (kernel, c_in, c_out) = sum over pairs of x[in]^T grad[out], in float32.
template <class T>
void weight_grad(const T* x, int32_t n_in, long c_in, const int32_t* neighbors, long n_out,
                 long kernel, const T* grad, long c_out, float* grad_weight, int threads) {
    constexpr long STEP = Product<T>::STEP;
    const long width = padded_width(c_out);
#pragma omp parallel for schedule(dynamic) num_threads(threads)
    for (long k = 0; k < kernel; ++k) {
        const long sums_bytes = round_up(c_in * width * 4, 64);
        const long a_bytes = round_up(WEIGHT_GRAD_PAIRS * c_in * sizeof(T), 64);
        const long g_bytes = round_up(WEIGHT_GRAD_PAIRS * width * sizeof(T), 64);
        char* memory = scratch.get(sums_bytes + a_bytes + g_bytes + 2 * (n_out + LANES) * 4);
        float* sums = reinterpret_cast<float*>(memory);
        T* a = reinterpret_cast<T*>(memory + sums_bytes);
        T* g = reinterpret_cast<T*>(memory + sums_bytes + a_bytes);
        int32_t* in = reinterpret_cast<int32_t*>(memory + sums_bytes + a_bytes + g_bytes);
        int32_t* out = in + n_out + LANES;
        std::memset(sums, 0, sums_bytes);
        const long count = list_pairs(neighbors + k * n_out, 0, n_out, n_in, in, out);
        for (long pair = 0; pair < count; pair += WEIGHT_GRAD_PAIRS) {
            const long some = count - pair < WEIGHT_GRAD_PAIRS ? count - pair : WEIGHT_GRAD_PAIRS;
            gather(x, c_in, in + pair, some, c_in, a);
            gather(grad, c_out, out + pair, some, width, g);
            weight_grad_block(a, c_in, g, width, round_up(some, STEP) / STEP, c_in, sums);
        }
        for (long i = 0; i < c_in; ++i)
            std::memcpy(grad_weight + (k * c_in + i) * c_out, sums + i * width, 4 * c_out);
    }
}

}  // namespace

#define EXPORT(T, SUFFIX)                                                                         \
    extern "C" long gcl_packed_size_##SUFFIX(long kernel, long c_in, long c_out) {                \
        return kernel * round_up(c_in, Product<T>::STEP) * padded_width(c_out);                   \
    }                                                                                             \
    extern "C" void gcl_pack_##SUFFIX(const float* weight, long kernel, long c_in, long c_out,    \
                                      int transposed, T* packed) {                                \
        pack<T>(weight, kernel, c_in, c_out, transposed, packed);                                 \
    }                                                                                             \
    extern "C" void gcl_conv_##SUFFIX(const T* x, int32_t n_in, long c_in,                        \
                                      const int32_t* neighbors, long n_out, long kernel,          \
                                      const T* packed, long c_out, const float* bias,             \
                                      const T* residual, int relu, T* out, int threads) {         \
        convolve<T>(x, n_in, c_in, neighbors, n_out, kernel, packed, c_out, bias, residual, relu, \
                    out, threads);                                                                \
    }                                                                                             \
    extern "C" void gcl_weight_grad_##SUFFIX(const T* x, int32_t n_in, long c_in,                 \
                                             const int32_t* neighbors, long n_out, long kernel,   \
                                             const T* grad, long c_out, float* grad_weight,       \
                                             int threads) {                                       \
        weight_grad<T>(x, n_in, c_in, neighbors, n_out, kernel, grad, c_out, grad_weight,         \
                       threads);                                                                  \
    }

EXPORT(float, f32)
EXPORT(bfloat16, bf16)
