// The entries that a call is about, and where in a ring of slots each entry is.
#pragma once

#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

#include "core/columns.hpp"
#include "core/snapshot.hpp"

namespace rtamt {

// The entries that a call is about, in rising order.
class Entries {
public:
    explicit Entries(std::size_t num) : all_(num), some_(num), chosen_(all_.data()) {
        std::iota(all_.begin(), all_.end(), 0u);
    }
    // Chooses the entries where the mask is true; all entries without a mask.
    void choose(const std::uint8_t* mask) {
        chosen_ = all_.data();
        if (mask == nullptr) return;
        count_ = 0;
        for (const std::uint32_t entry : all_) {  // without a branch for each entry
            some_[count_] = entry;
            count_ += mask[entry] != 0;
        }
        if (count_ < all_.size()) chosen_ = some_.data();
    }

    std::size_t num() const { return all_.size(); }
    bool all() const { return chosen_ == all_.data(); }
    std::size_t count() const { return all() ? all_.size() : count_; }
    std::uint32_t operator[](std::size_t i) const { return chosen_[i]; }

private:
    std::vector<std::uint32_t> all_;
    std::vector<std::uint32_t> some_;  // the chosen ones first
    std::size_t count_ = 0;
    const std::uint32_t* chosen_;
};

// Calls run(entry, i, n) for stretches of chosen entries, entry + j being the chosen one number i +
// j: once for all entries, if that is allowed, so that the loops inside are long, and of the widest
// vectors if it is a lambda with RTAMT_LOOP_BODY.
template <class Run>
inline void each_stretch(const Entries& entries, bool together, const Run& run) {
    if (entries.all() && together) {
        widely([&]() RTAMT_LOOP_BODY { run(std::size_t{0}, std::size_t{0}, entries.num()); });
    } else {
        for (std::size_t i = 0; i < entries.count(); ++i)
            run(std::size_t{entries[i]}, i, std::size_t{1});
    }
}

// The place of every entry in the rings that keep its last samples: a count that rises with each
// sample and is never reset. Entries that take every sample share one place, whatever their times;
// an entry without samples has no place of its own, and takes the others' place.
class Places {
public:
    explicit Places(std::size_t num) : late_(num) {}

    // Moves the chosen entries to the places of their next samples.
    void advance(const Entries& entries, const std::int64_t* samples) {
        if (entries.all()) {
            ++newest_;
            return;
        }
        bool moved = false;
        for (std::size_t i = 0; i < entries.count(); ++i) moved |= samples[entries[i]] > 0;
        if (!moved) return;
        ++newest_;
        std::size_t i = 0;
        for (std::size_t entry = 0; entry < late_.size(); ++entry) {
            if (i < entries.count() && entries[i] == entry) {
                ++i;
            } else if (samples[entry] > 0) {
                ++late_[entry];
                together_ = false;
            }
        }
    }
    void reset(const Entries& entries) {
        if (entries.all()) newest_ = 0;
        if (together_) return;
        for (std::size_t i = 0; i < entries.count(); ++i) late_[entries[i]] = 0;
        find_together();
    }

    bool together() const { return together_; }
    std::uint64_t of(std::size_t entry) const { return newest_ - late_[entry]; }

    void fields(Snapshot& s) {
        s(newest_);
        s.array(late_.data(), late_.size());
        for (const std::uint64_t late : late_) s.require(late <= newest_ && newest_ >> 62 == 0);
        if (s.reads()) find_together();
    }

private:
    void find_together() {
        together_ = true;
        for (const std::uint64_t late : late_) together_ &= late == 0;
    }

    std::uint64_t newest_ = 0;
    std::vector<std::uint64_t> late_;
    bool together_ = true;
};

}  // namespace rtamt
