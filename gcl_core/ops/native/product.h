// One instruction's worth of a matrix product, in float32 and bfloat16.

#pragma once

#include <cstdint>
#include <cstring>

#if defined(__AVX512BF16__)
#include <immintrin.h>
#endif

namespace {

#if defined(__AVX512F__)
constexpr long LANES = 16;
constexpr int WIDE = 4;  // vectors in a register block: 6 x 4 sums in 32 registers
#else
constexpr long LANES = 8;
constexpr int WIDE = 2;  // 6 x 2 sums in 16 registers
#endif

typedef float Vector __attribute__((vector_size(4 * LANES), aligned(4), may_alias));
typedef uint16_t bfloat16;

// STEP consecutive input channels are multiplied by one instruction.
template <class T> struct Product;
template <> struct Product<float> {
    static constexpr long STEP = 1;
    static inline void add(Vector& sum, const float* a, const float* b) {
        sum += *a * *reinterpret_cast<const Vector*>(b);
    }
};
#if defined(__AVX512BF16__)
template <> struct Product<bfloat16> {
    static constexpr long STEP = 2;
    static inline void add(Vector& sum, const bfloat16* a, const bfloat16* b) {
        int32_t two;
        std::memcpy(&two, a, 4);
        sum = (Vector)_mm512_dpbf16_ps((__m512)sum, (__m512bh)_mm512_set1_epi32(two),
                                       (__m512bh)_mm512_loadu_si512(b));
    }
};
#endif

}  // namespace
