// Numbers of the kernels: float32 and bfloat16, and one instruction's worth of their products.

#pragma once

#include <cstdint>
#include <cstring>

#if defined(__AVX512F__)
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

inline float widen(float value) { return value; }
inline float widen(bfloat16 value) {
    uint32_t bits = uint32_t(value) << 16;
    float out;
    std::memcpy(&out, &bits, 4);
    return out;
}
inline void narrow(float value, float& out) { out = value; }
inline void narrow(float value, bfloat16& out) {  // to nearest, ties to even; NaN stays NaN
    uint32_t bits;
    std::memcpy(&bits, &value, 4);
    out = value != value ? 0x7FC0 : bfloat16((bits + 0x7FFF + ((bits >> 16) & 1)) >> 16);
}

// LANES numbers to and from float32.
inline Vector load(const float* from) { return *reinterpret_cast<const Vector*>(from); }
typedef uint16_t Half __attribute__((vector_size(2 * LANES), aligned(2), may_alias));
typedef uint32_t Bits __attribute__((vector_size(4 * LANES)));
inline Vector load(const bfloat16* from) {
    return (Vector)(__builtin_convertvector(*reinterpret_cast<const Half*>(from), Bits) << 16);
}
inline void store(Vector value, float* to) { *reinterpret_cast<Vector*>(to) = value; }
inline void store(Vector value, bfloat16* to) {  // as `narrow`
    const Bits bits = (Bits)value;
    const Bits rounded = (bits + 0x7FFF + ((bits >> 16) & 1)) >> 16;
    const Bits chosen = value != value ? Bits{} + 0x7FC0 : rounded;
    *reinterpret_cast<Half*>(to) = __builtin_convertvector(chosen, Half);
}

// Of LANES numbers, those below `limit` one behind the other, and their places, counted from
// `place`; returns how many there are. Writes LANES numbers to both.
inline long keep_below(const int32_t* from, int32_t limit, int32_t place, int32_t* kept,
                       int32_t* places) {
#if defined(__AVX512F__)
    const __m512i numbers = _mm512_loadu_si512(from);
    const __m512i all = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    const __mmask16 below = _mm512_cmplt_epi32_mask(numbers, _mm512_set1_epi32(limit));
    const __m512i here = _mm512_add_epi32(all, _mm512_set1_epi32(place));
    _mm512_storeu_si512(kept, _mm512_maskz_compress_epi32(below, numbers));
    _mm512_storeu_si512(places, _mm512_maskz_compress_epi32(below, here));
    return __builtin_popcount(below);
#else
    long count = 0;
    for (long lane = 0; lane < LANES; ++lane) {
        kept[count] = from[lane];
        places[count] = place + int32_t(lane);
        count += from[lane] < limit;
    }
    return count;
#endif
}

// STEP consecutive input channels are multiplied by one instruction.
template <class T> struct Product;
template <> struct Product<float> {
    static constexpr long STEP = 1;
    static inline void add(Vector& sum, const float* a, const float* b) {
        sum += *a * *reinterpret_cast<const Vector*>(b);
    }
};
template <> struct Product<bfloat16> {
    static constexpr long STEP = 2;
    static inline void add(Vector& sum, const bfloat16* a, const bfloat16* b) {
#if defined(__AVX512BF16__)
        int32_t two;
        std::memcpy(&two, a, 4);
        sum = (Vector)_mm512_dpbf16_ps((__m512)sum, (__m512bh)_mm512_set1_epi32(two),
                                       (__m512bh)_mm512_loadu_si512(b));
#else  // the upper half of a float32 is a bfloat16
        Bits pairs;
        std::memcpy(&pairs, b, sizeof pairs);
        sum += widen(a[0]) * (Vector)(pairs << 16);
        sum += widen(a[1]) * (Vector)(pairs & 0xFFFF0000u);
#endif
    }
};

}  // namespace
