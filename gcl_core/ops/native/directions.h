// In which cell of a range image a direction lies: the compiled twin of `direction_cell` in
// gcl_core/estimation/surface.py.
//
// Every step is exact or rounded once, whatever the instructions: products are of float32 numbers
// in float64, so that it does not matter which of them are fused with a sum.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace {

// How many of some ascending numbers are at most another one, by one look-up: buckets are so
// narrow that each holds one of the numbers at most.
class Steps {
public:
    Steps(const float* numbers, int count) {
        while (!fill(numbers, count)) scale_ *= 2;
    }
    int up_to(float value) const {
        const Bucket& bucket = buckets_[place(value)];
        return bucket.below + (value >= bucket.number);
    }

private:
    struct Bucket {
        float number;
        int32_t below;
    };

    // Grows with the value; `scale_` is a power of two, so that its product is exact.
    int place(float value) const {
        const float at = value * scale_ + offset_;
        return at >= 0 ? int(std::min(at, last_)) : 0;
    }
    bool fill(const float* numbers, int count) {
        offset_ = 1 - std::floor(numbers[0] * scale_);
        last_ = std::floor(numbers[count - 1] * scale_ + offset_) + 1;
        buckets_.assign(int(last_) + 1, {std::numeric_limits<float>::quiet_NaN(), 0});
        for (int i = 0; i < count; ++i) {
            Bucket& bucket = buckets_[place(numbers[i])];
            if (bucket.number == bucket.number) return false;
            bucket.number = numbers[i];
        }
        int32_t below = 0;
        for (Bucket& bucket : buckets_) {
            bucket.below = below;
            below += bucket.number == bucket.number;
        }
        return true;
    }

    float scale_ = 1, offset_ = 0, last_ = 0;
    std::vector<Bucket> buckets_;
};

constexpr int BLOCK = 128;    // points whose quotients are taken together
constexpr float LEAST = 1e-30f;  // metres: a divisor instead of 0

struct Directions {
    float rise[BLOCK], slope[BLOCK], distance[BLOCK];
    float x[BLOCK], y[BLOCK], z[BLOCK];
};

// Quotients and ranges of the points at x, y and z.
inline void measure(Directions& to) {
    for (int i = 0; i < BLOCK; ++i) {
        const double x = to.x[i], y = to.y[i], z = to.z[i];
        const double flat = x * x + y * y;
        const float across = std::fabs(to.y[i]), along = std::fabs(to.x[i]);
        const float most = across > along ? across : along;
        const float least = across > along ? along : across;
        const float aside = float(std::sqrt(flat));
        to.rise[i] = to.z[i] / (aside > LEAST ? aside : LEAST);
        to.slope[i] = least / (most > LEAST ? most : LEAST);
        to.distance[i] = float(std::sqrt(flat + z * z));
    }
}

class Image {
public:
    Image(const float* column_slopes, int columns, const float* row_slopes, int rows)
        : column_(column_slopes, columns / 8),
          row_(row_slopes, rows + 1),
          rows_(rows),
          columns_(columns) {}

    // Flat cell of a point of the block; -1 above and below the image.
    int cell(const Directions& of, int i) const {
        const int row = row_.up_to(of.rise[i]) - 1;
        if (row < 0 || row >= rows_) return -1;
        int steps = column_.up_to(of.slope[i]);
        if (std::fabs(of.y[i]) > std::fabs(of.x[i])) steps = columns_ / 4 - 1 - steps;
        const bool behind = of.x[i] < 0, right = of.y[i] < 0;
        // Columns begin straight behind and go by the right, the front and the left.
        const int half = behind ? steps : columns_ / 2 - 1 - steps;
        return row * columns_ + (right ? half : columns_ - 1 - half);
    }

private:
    Steps column_, row_;
    int rows_, columns_;
};

}  // namespace
