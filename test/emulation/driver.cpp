// Calls functions of a shared library for another program: requests on stdin, replies on stdout.
//
// Runs on aarch64 only, whose calling convention takes integers and pointers in one row, whatever
// their width, and floating-point numbers in another.

#include <dlfcn.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

namespace {

constexpr int INTEGERS = 20, REALS = 4;
typedef int64_t (*Function)(int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t,
                            int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t,
                            int64_t, int64_t, int64_t, int64_t, double, double, double, double);

template <class T> T read() {
    T value;
    if (std::fread(&value, sizeof value, 1, stdin) != 1) std::exit(0);
    return value;
}

std::vector<char> read_bytes(uint64_t count) {
    std::vector<char> bytes(count);
    if (count && std::fread(bytes.data(), 1, count, stdin) != count) std::exit(1);
    return bytes;
}

void write(const void* from, size_t count) { std::fwrite(from, 1, count, stdout); }

}  // namespace

int main(int, char** arguments) {
    void* library = dlopen(arguments[1], RTLD_NOW);
    if (!library) return std::fprintf(stderr, "%s\n", dlerror()), 2;
    for (;;) {
        const std::vector<char> name = read_bytes(read<uint64_t>());
        void* found = dlsym(library, std::string(name.begin(), name.end()).c_str());
        if (!found) return std::fprintf(stderr, "%s\n", dlerror()), 3;
        std::vector<std::vector<char>> buffers;
        int64_t i[INTEGERS] = {};
        double r[REALS] = {};
        int integers = 0, reals = 0;
        for (uint64_t left = read<uint64_t>(); left; --left) {
            const char kind = read<char>();
            if (kind == 'p') {
                buffers.push_back(read_bytes(read<uint64_t>()));
                i[integers++] = reinterpret_cast<int64_t>(buffers.back().data());
            } else if (kind == 'i') {
                i[integers++] = read<int64_t>();
            } else if (kind == 'd') {
                r[reals++] = read<double>();
            } else {  // a float32 lies in the lower half of its register
                const float value = read<float>();
                std::memcpy(&r[reals++], &value, sizeof value);
            }
        }
        const int64_t result = reinterpret_cast<Function>(found)(
            i[0], i[1], i[2], i[3], i[4], i[5], i[6], i[7], i[8], i[9], i[10], i[11], i[12], i[13],
            i[14], i[15], i[16], i[17], i[18], i[19], r[0], r[1], r[2], r[3]);
        write(&result, sizeof result);
        for (const auto& buffer : buffers) write(buffer.data(), buffer.size());
        std::fflush(stdout);
    }
}
