// Occupied voxels as an octree, entropy coded: the compiled twin of gcl_core/compact/octree.py.
//
// Integers alone, so that every machine writes and reads the same bytes.

#include <algorithm>
#include <cstdint>
#include <vector>

namespace {

constexpr int AXIS_BITS = 16;
constexpr int64_t AXIS = (int64_t(1) << AXIS_BITS) - 1;
constexpr int RATE = 5;            // a probability moves by 1/32 of its error
constexpr int CONTEXT_BITS = 18;
constexpr int LEVEL_CLASSES = 4;   // finest, second, third, the rest

// Nodes around one, in the order that contexts name them. Of the first 10 the children are read,
// where they are coded already; of the last 3 whether they exist.
constexpr int AROUND = 13, READ = 10;
constexpr int OFFSETS[AROUND][3] = {
    {-1, 0, 0}, {0, -1, 0}, {0, 0, -1}, {-1, -1, 0}, {-1, 0, -1}, {0, -1, -1}, {-1, -1, -1},
    {-1, 1, 0}, {-1, 0, 1}, {0, -1, 1}, {1, 0, 0},  {0, 1, 0},   {0, 0, 1}};

inline int64_t pack(int64_t x, int64_t y, int64_t z) {
    return x * (int64_t(1) << 2 * AXIS_BITS) + y * (int64_t(1) << AXIS_BITS) + z;
}
inline int64_t child_of(int64_t key, int child) {
    const int64_t x = key >> 2 * AXIS_BITS, y = key >> AXIS_BITS & AXIS, z = key & AXIS;
    return pack(2 * x + (child >> 2), 2 * y + (child >> 1 & 1), 2 * z + (child & 1));
}

// Cell (i, j, k) of the 4 x 4 x 4 around a node whose own children are at 1 and 2 on each axis.
inline int cell(int i, int j, int k) { return 16 * i + 4 * j + k; }

struct Tables {
    uint64_t spread[READ][256];  // children of a node around as cells
    int shift[8][READ];          // cell of each neighbour of a child
    int own[8];
    Tables() {
        for (int o = 0; o < READ; ++o)
            for (int byte = 0; byte < 256; ++byte) {
                spread[o][byte] = 0;
                for (int child = 0; child < 8; ++child) {
                    const int i = 2 * OFFSETS[o][0] + 1 + (child >> 2);
                    const int j = 2 * OFFSETS[o][1] + 1 + (child >> 1 & 1);
                    const int k = 2 * OFFSETS[o][2] + 1 + (child & 1);
                    const bool inside = i >= 0 && i < 4 && j >= 0 && j < 4 && k >= 0 && k < 4;
                    if ((byte >> child & 1) && inside) spread[o][byte] |= uint64_t(1) << cell(i, j, k);
                }
            }
        for (int child = 0; child < 8; ++child) {
            const int i = 1 + (child >> 2), j = 1 + (child >> 1 & 1), k = 1 + (child & 1);
            own[child] = cell(i, j, k);
            for (int o = 0; o < READ; ++o)
                shift[child][o] = cell(i + OFFSETS[o][0], j + OFFSETS[o][1], k + OFFSETS[o][2]);
        }
    }
};
const Tables tables;

class Writer {
  public:
    static constexpr bool READS = false;
    Writer(uint8_t* out, int64_t capacity) : out_(out), end_(out + capacity) {}
    int code(int bit, uint32_t probability) {
        const uint32_t middle = low_ + uint32_t(uint64_t(high_ - low_) * probability >> 16);
        if (bit) high_ = middle; else low_ = middle + 1;
        while (((low_ ^ high_) & 0xFF000000) == 0) {
            put(high_ >> 24);
            low_ <<= 8;
            high_ = high_ << 8 | 255;
        }
        return bit;
    }
    void flush() { for (int shift = 24; shift >= 0; shift -= 8) put(low_ >> shift & 255); }
    int64_t written(const uint8_t* begin) const { return full_ ? -1 : out_ - begin; }
  private:
    void put(uint32_t byte) {
        if (out_ < end_) *out_++ = uint8_t(byte); else full_ = true;
    }
    uint8_t *out_, *end_;
    uint32_t low_ = 0, high_ = 0xFFFFFFFF;
    bool full_ = false;
};

class Reader {
  public:
    static constexpr bool READS = true;
    Reader(const uint8_t* in, int64_t size) : in_(in), end_(in + size) {
        for (int i = 0; i < 4; ++i) code_ = code_ << 8 | next();
    }
    int code(int, uint32_t probability) {
        const uint32_t middle = low_ + uint32_t(uint64_t(high_ - low_) * probability >> 16);
        const int bit = code_ <= middle;
        if (bit) high_ = middle; else low_ = middle + 1;
        while (((low_ ^ high_) & 0xFF000000) == 0) {
            low_ <<= 8;
            high_ = high_ << 8 | 255;
            code_ = code_ << 8 | next();
        }
        return bit;
    }
  private:
    uint32_t next() { return in_ < end_ ? *in_++ : 0; }
    const uint8_t *in_, *end_;
    uint32_t low_ = 0, high_ = 0xFFFFFFFF, code_ = 0;
};

// Codes the children of all nodes of a level, `children` in place, known if written.
template <class Coder>
void code_level(Coder& coder, const std::vector<int64_t>& nodes, std::vector<uint8_t>& children,
                int level_class, uint16_t* probabilities) {
    const size_t count = nodes.size();
    size_t pointer[AROUND] = {};
    int64_t offset[AROUND];
    for (int o = 0; o < AROUND; ++o)
        offset[o] = pack(OFFSETS[o][0], OFFSETS[o][1], OFFSETS[o][2]);
    std::vector<uint8_t> done(count, 0);
    for (size_t n = 0; n < count; ++n) {
        uint64_t cells = 0;
        uint32_t beyond = 0;
        for (int o = 0; o < AROUND; ++o) {
            const int64_t wanted = nodes[n] + offset[o];
            size_t& at = pointer[o];
            while (at < count && nodes[at] < wanted) ++at;
            if (at == count || nodes[at] != wanted) continue;
            if (o < READ) cells |= tables.spread[o][done[at]];
            else beyond |= 1u << (o - READ);
        }
        uint32_t byte = 0;
        for (int child = 0; child < 8; ++child) {
            if (child == 7 && byte == 0) { byte = 128; break; }  // a node has a child
            const int* shift = tables.shift[child];
            uint32_t near = 0, more = 0;
            for (int o = 0; o < 7; ++o) near |= uint32_t(cells >> shift[o] & 1) << o;
            for (int o = 7; o < READ; ++o) more |= uint32_t(cells >> shift[o] & 1) << (o - 7);
            const uint32_t faces = uint32_t(child >> 2 | (child & 2) | (child & 1) << 2) & beyond;
            const uint32_t context =
                (((uint32_t(level_class) << 7 | near) << 3 | faces) << 3 | child) << 3 | more;
            uint16_t& p = probabilities[context];
            const int bit = coder.code(children[n] >> child & 1, p);
            if (bit) p += (65536 - p) >> RATE; else p -= p >> RATE;
            byte |= uint32_t(bit) << child;
            cells |= uint64_t(bit) << tables.own[child];
        }
        done[n] = uint8_t(byte);
    }
    if (Coder::READS) children = done;
}

inline int class_of(int level, int depth) {
    const int above_finest = depth - 1 - level;
    return above_finest < LEVEL_CLASSES ? above_finest : LEVEL_CLASSES - 1;
}

}  // namespace

// keys: n > 0 sorted voxels below 2^depth on each axis. probabilities: 2^18, changed.
// Returns the number of bytes, -1 where they do not fit into `capacity`.
extern "C" int64_t gcl_octree_encode(const int64_t* keys, int64_t n, int depth,
                                     uint16_t* probabilities, uint8_t* out, int64_t capacity) {
    std::vector<std::vector<int64_t>> nodes(depth + 1);
    std::vector<std::vector<uint8_t>> children(depth);
    nodes[depth].assign(keys, keys + n);
    for (int level = depth - 1; level >= 0; --level) {
        std::vector<int64_t> entries;
        for (const int64_t key : nodes[level + 1]) {
            const int64_t x = key >> 2 * AXIS_BITS, y = key >> AXIS_BITS & AXIS, z = key & AXIS;
            const int64_t child = (x & 1) << 2 | (y & 1) << 1 | (z & 1);
            entries.push_back(pack(x >> 1, y >> 1, z >> 1) << 3 | child);
        }
        std::sort(entries.begin(), entries.end());
        for (const int64_t entry : entries) {
            if (nodes[level].empty() || nodes[level].back() != entry >> 3) {
                nodes[level].push_back(entry >> 3);
                children[level].push_back(0);
            }
            children[level].back() |= 1 << (entry & 7);
        }
    }
    Writer writer(out, capacity);
    for (int level = 0; level < depth; ++level)
        code_level(writer, nodes[level], children[level], class_of(level, depth), probabilities);
    writer.flush();
    return writer.written(out);
}

// keys: room for `count`. Returns how many voxels there are, -1 where they are not `count`.
extern "C" int64_t gcl_octree_decode(const uint8_t* data, int64_t size, int depth,
                                     uint16_t* probabilities, int64_t* keys, int64_t count) {
    Reader reader(data, size);
    std::vector<int64_t> nodes{0};
    for (int level = 0; level < depth; ++level) {
        std::vector<uint8_t> children(nodes.size(), 0);
        code_level(reader, nodes, children, class_of(level, depth), probabilities);
        std::vector<int64_t> next;
        for (size_t n = 0; n < nodes.size(); ++n)
            for (int child = 0; child < 8; ++child)
                if (children[n] >> child & 1) next.push_back(child_of(nodes[n], child));
        if (int64_t(next.size()) > count) return -1;
        std::sort(next.begin(), next.end());
        nodes.swap(next);
    }
    if (int64_t(nodes.size()) != count) return -1;
    std::copy(nodes.begin(), nodes.end(), keys);
    return count;
}

static_assert(LEVEL_CLASSES << 16 == 1 << CONTEXT_BITS, "a context has 18 bits");
