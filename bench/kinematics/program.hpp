// Shared by the programs of this folder: reads a chain and configurations, measures in batches, and writes the results.
// A program is called with CHAIN CONFIGURATIONS POSES, writes a line `p R J` per configuration to POSES (row-major, base
// axes, J as rows v w of the flange's origin) and prints one line of JSON with ns per call.
#pragma once
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iomanip>
#include <limits>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

// The joint's frame is Trans(origin) * Rot(axis, zero + sign * q) in that of the joint before it.
struct Axis {
    std::array<double, 3> axis, origin;
    double zero, sign;
};

struct Chain {
    std::vector<Axis> axes;
    std::array<double, 3> tip;
};

inline std::ifstream opened(const char *path) {
    std::ifstream file(path);
    if (!file) throw std::runtime_error(std::string("cannot read ") + path);
    return file;
}

// First line: the flange in the last joint's frame, x y z. Then one line per joint: axis, origin, zero, sign.
inline Chain read_chain(const char *path) {
    std::ifstream file = opened(path);
    Chain chain;
    file >> chain.tip[0] >> chain.tip[1] >> chain.tip[2];
    for (Axis a; file >> a.axis[0] >> a.axis[1] >> a.axis[2] >> a.origin[0] >> a.origin[1] >> a.origin[2] >> a.zero >> a.sign;)
        chain.axes.push_back(a);
    return chain;
}

// One configuration per line, rad.
inline std::vector<std::vector<double>> read_configurations(const char *path, std::size_t joints) {
    std::ifstream file = opened(path);
    std::vector<std::vector<double>> all;
    for (std::string line; std::getline(file, line);) {
        std::istringstream text(line);
        std::vector<double> one;
        for (double q; text >> q;) one.push_back(q);
        if (one.size() != joints) throw std::runtime_error("a configuration has the wrong number of joints");
        all.push_back(one);
    }
    return all;
}

// Returns a seed near each configuration, for iterative solvers. In -1 to 1 by a linear congruential generator
// (Knuth, TAOCP 2, 3.3.4, table 1, line 26).
inline std::vector<std::vector<double>> beside(std::vector<std::vector<double>> all, double by_rad) {
    unsigned long state = 7;
    for (auto &one : all)
        for (double &q : one) {
            state = state * 6364136223846793005UL + 1442695040888963407UL;
            q += by_rad * (double(state >> 11) / double(1UL << 52) - 1.0);
        }
    return all;
}

// Returns ns per call: the best of several batches over all configurations. Other programs on the machine only add time.
template <class Call> double measure(std::size_t configurations, int batches, Call call) {
    double best_ns = std::numeric_limits<double>::infinity();
    for (int batch = 0; batch < batches; ++batch) {
        const auto begun = std::chrono::steady_clock::now();
        for (std::size_t k = 0; k < configurations; ++k) call(k);
        const auto took = std::chrono::steady_clock::now() - begun;
        best_ns = std::min(best_ns, std::chrono::duration<double, std::nano>(took).count() / double(configurations));
    }
    return best_ns;
}

// Keeps the optimizer from dropping a result.
template <class T> inline void keep(T const &value) { asm volatile("" : : "r,m"(value) : "memory"); }

inline void print(const std::string &version, const std::map<std::string, double> &figures) {
    std::printf("{\"version\": \"%s\"", version.c_str());
    for (const auto &[name, value] : figures) std::printf(", \"%s\": %.17g", name.c_str(), value);
    std::printf("}\n");
}
