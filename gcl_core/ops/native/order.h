// Rows in the order of the cells that they lie in.

#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

namespace {

constexpr int MOST_DIGIT = 11;  // bits: counters that stay in the first-level cache
constexpr int ROW_BITS = 24;
constexpr uint64_t ROW = (uint64_t(1) << ROW_BITS) - 1;

// Sorts by the bits from `low` up to `high`; equal entries stay in their order.
void radix_sort(std::vector<uint64_t>& entries, int low, int high) {
    std::vector<uint64_t> other(entries.size());
    const int passes = (high - low + MOST_DIGIT - 1) / MOST_DIGIT;
    const int digit = passes ? (high - low + passes - 1) / passes : 0;
    const uint64_t mask = (uint64_t(1) << digit) - 1;
    for (int shift = low; shift < high; shift += digit) {
        std::array<uint32_t, (1 << MOST_DIGIT) + 1> begin{};
        for (const uint64_t entry : entries) ++begin[((entry >> shift) & mask) + 1];
        for (size_t i = 1; i <= mask; ++i) begin[i] += begin[i - 1];
        for (const uint64_t entry : entries) other[begin[(entry >> shift) & mask]++] = entry;
        entries.swap(other);
    }
}

inline int bits_of(uint64_t value) {
    int bits = 0;
    while (value >> bits) ++bits;
    return bits;
}

// Rows of voxel keys in the order of the keys, in the low ROW_BITS of each entry; what is above
// them is the same for equal keys. False where there is no room: too many rows, too far apart.
bool sort_rows(const int64_t* keys, int64_t n, int axis_bits, std::vector<uint64_t>& entries) {
    constexpr int FIELDS = 4;  // z, y, x and scan
    const uint64_t mask = (uint64_t(1) << axis_bits) - 1;
    uint64_t low[FIELDS], high[FIELDS] = {};
    std::fill(low, low + FIELDS, UINT64_MAX);
    if (n >= int64_t(1) << ROW_BITS) return false;
    for (int64_t i = 0; i < n; ++i)
        for (int f = 0; f < FIELDS; ++f) {
            const uint64_t value = uint64_t(keys[i]) >> f * axis_bits & mask;
            low[f] = std::min(low[f], value);
            high[f] = std::max(high[f], value);
        }
    int shift[FIELDS + 1] = {ROW_BITS};
    for (int f = 0; f < FIELDS; ++f) shift[f + 1] = shift[f] + bits_of(high[f] - low[f]);
    if (n == 0 || shift[FIELDS] > 64) return n == 0;
    entries.resize(n);
    for (int64_t i = 0; i < n; ++i) {
        entries[i] = uint64_t(i);
        for (int f = 0; f < FIELDS; ++f)
            entries[i] |= ((uint64_t(keys[i]) >> f * axis_bits & mask) - low[f]) << shift[f];
    }
    radix_sort(entries, ROW_BITS, shift[FIELDS]);
    return true;
}

}  // namespace
