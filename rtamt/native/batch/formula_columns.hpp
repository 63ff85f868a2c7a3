// What a call of take works on: columns with a value for each chosen entry.
#pragma once

#include <vector>

#include "discrete/columns.hpp"
#include "episode/streams.hpp"
#include "batch/entries.hpp"

namespace rtamt::batch {

using episode::kAll;
using episode::kLower;
using episode::kNever;
using episode::kNow;
using episode::kUpper;
using episode::Time;
using episode::World;

// The terms of the chosen entries, and what min and max make of them.
class FormulaColumns {
public:
    FormulaColumns(std::size_t terms, std::size_t num) : terms_(terms), num_(num) {}

    std::size_t constant(double value) {
        made_.emplace_back(num_, value);
        return terms_ + made_.size() - 1;
    }
    std::size_t map(bool is_min, std::size_t a, std::size_t b) {
        const std::size_t out = constant(0.0);
        maps_.push_back({is_min, a, b, out});
        return out;
    }

    // Finds the values of the first `count` chosen entries from their terms.
    void find(const RegisterColumns& terms, std::size_t count) {
        from_ = &terms;
        for (const Map& m : maps_) {
            double* out = made_[m.out - terms_].data();
            if (m.is_min) {
                columns::map<lesser>(at(m.a), at(m.b), out, count);
            } else {
                columns::map<greater>(at(m.a), at(m.b), out, count);
            }
        }
    }
    const double* at(std::size_t slot) const {
        return slot < terms_ ? from_->at(slot) : made_[slot - terms_].data();
    }

private:
    struct Map {
        bool is_min;
        std::size_t a;
        std::size_t b;
        std::size_t out;
    };

    std::size_t terms_;
    std::size_t num_;
    const RegisterColumns* from_ = nullptr;
    std::vector<std::vector<double>> made_;
    std::vector<Map> maps_;
};

// A call of take: the chosen entries, the times of their samples, and columns of the values there.
struct Taken {
    const Entries& entries;
    const Places& places;
    const std::int64_t* times;  // of all entries
    Time first;                 // of the times of the chosen entries
    Time last;
    const FormulaColumns& columns;
};

}  // namespace rtamt::batch
