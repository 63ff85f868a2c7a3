// The bounds of many episodes of one program.
#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "batch/entries.hpp"
#include "discrete/columns.hpp"
#include "episode/machine.hpp"

namespace rtamt::batch {

// What every entry gives; each has an element for each entry.
struct EpisodeValues {
    explicit EpisodeValues(std::size_t num)
        : samples(num), finished(num), now(num), lower(num), upper(num) {}

    std::vector<std::int64_t> samples;
    std::vector<std::uint8_t> finished;
    std::vector<double> now;
    std::vector<double> lower;
    std::vector<double> upper;
};

class Episodes {
public:
    Episodes() = default;
    Episodes(const Episodes&) = delete;
    Episodes& operator=(const Episodes&) = delete;
    virtual ~Episodes() = default;

    // Takes in one sample of every chosen entry. The inputs are a column for each variable, of all
    // entries; the terms are columns of the chosen ones.
    virtual void take(const Entries& entries, const double* inputs, RegisterColumns& terms) = 0;
    virtual void reset(const Entries& entries) = 0;
    // Ends the traces of the chosen entries, of at least one sample each; those that have ended
    // already stay as they are.
    virtual void finish(const Entries& entries, End end) = 0;
    virtual void fields(Snapshot& s) = 0;
};

// Makes the episodes of a program; the values are theirs to write.
std::unique_ptr<Episodes> episodes_of(const episode::Program& program, EpisodeValues& values);

}  // namespace rtamt::batch
