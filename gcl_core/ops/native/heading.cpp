// The votes for a scan's dominant heading: the compiled twin of `_votes` in
// gcl_core/ops/heading.py.
//
// Columns are counted in whole numbers, and the votes added up as such, so that the order of the
// points does not matter. What is rounded is never a sum of products, which compilers fuse where
// the processor can: every instruction set gives the bits of numpy.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace {

constexpr int SHIFTS = 2;

struct Standing {  // a point that may stand on the ground
    float z;
    int32_t ground;  // cell of the ground grid
    int32_t row, column;
};

struct Piece {
    int32_t count, x, y, xx, yy, xy;  // sums over the columns of a piece
};

inline int32_t floor_of(float value) {
    const int32_t whole = int32_t(value);
    return whole - (value < float(whole));
}

// Adds a piece's direction, four times as fast, to `vote`.
void add_vote(const Piece& p, double thin, double scale, int64_t* vote) {
    const double n = p.count;
    const double xx = n * p.xx - double(p.x) * p.x, yy = n * p.yy - double(p.y) * p.y;
    const double xy = n * p.xy - double(p.x) * p.y;
    const double across = xx - yy, along = 2 * xy;
    const double thick = ((xx + yy) / thin + n * n) * thin;
    const double squared = thick * thick;
    const double weight = n * (across * across + along * along) / (squared * squared);
    vote[0] += std::llrint(weight * (across * across - along * along) * scale);
    vote[1] += std::llrint(weight * (2 * across * along) * scale);
}

}  // namespace

// How the scan is cut, and what counts.
struct Cut {
    double nearest, farthest;            // from the sensor
    double ground_cell, solid_height;
    double cell;                         // of the grid of columns
    double thin, scale;                  // see `add_vote`
};

// piece (SHIFTS, side): the row of pieces, of `pieces`, that each row of columns belongs to; rows
// and columns of a grid are cut alike. vote: its two numbers, times `cut.scale`.
extern "C" void gcl_heading(const float* points, int64_t n, const Cut* cut, int ground_side,
                            int side, const int32_t* piece, int pieces, int fewest,
                            int64_t* vote) {
    const float ground_cell = float(cut->ground_cell), cell = float(cut->cell);
    const float solid_height = float(cut->solid_height);
    const double inner = cut->nearest * cut->nearest;
    const double outer = cut->farthest * cut->farthest;
    std::vector<float> lowest(ground_side * ground_side, std::numeric_limits<float>::infinity());
    std::vector<Standing> standing(n);
    int64_t count = 0;
    for (int64_t i = 0; i < n; ++i) {
        const float x = points[3 * i], y = points[3 * i + 1], z = points[3 * i + 2];
        const double flat = double(x) * x + double(y) * y;  // exact products
        if (!(flat > inner && flat < outer)) continue;
        const int32_t ground = (floor_of(x / ground_cell) + ground_side / 2) * ground_side +
                               floor_of(y / ground_cell) + ground_side / 2;
        lowest[ground] = std::min(lowest[ground], z);
        const int32_t row = floor_of(x / cell) + side / 2, column = floor_of(y / cell) + side / 2;
        standing[count++] = {z, ground, row, column};
    }
    std::vector<char> seen(side * side);
    std::vector<Piece> found(SHIFTS * pieces * pieces);
    for (int64_t i = 0; i < count; ++i) {
        const Standing& s = standing[i];
        char& known = seen[s.row * side + s.column];
        if (!(s.z - lowest[s.ground] > solid_height) || known) continue;
        known = 1;
        const int32_t x = s.row - side / 2, y = s.column - side / 2;
        for (int shift = 0; shift < SHIFTS; ++shift) {
            const int32_t* of = piece + shift * side;
            Piece& p = found[(shift * pieces + of[s.row]) * pieces + of[s.column]];
            p = {p.count + 1, p.x + x, p.y + y, p.xx + x * x, p.yy + y * y, p.xy + x * y};
        }
    }
    vote[0] = vote[1] = 0;
    for (const Piece& p : found)
        if (p.count >= fewest) add_vote(p, cut->thin, cut->scale, vote);
}
