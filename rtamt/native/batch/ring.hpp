// Folds of the last elements of every entry.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/folds.hpp"
#include "batch/slots.hpp"

namespace rtamt::batch {

// The fold of the last `length` elements of every entry, 1 or more: SlidingWindow in columns. What
// it gives is right for entries that have pushed so many, whatever the slots held before: an entry that
// begins anew clears nothing.
template <class F>
class RingFold {
public:
    using Element = typename F::Element;

    RingFold(std::size_t length, std::size_t num)
        : block_(length / 2), ahead_(1 - length % 2), num_(num), slots_(2 * block_ + 4, num) {
        clear();
    }
    void clear() {
        slots_.clear();
        const auto identity = slots_.at(kIdentity);
        for (std::size_t i = 0; i < num_; ++i) identity.put(i, F::identity);
    }

    // Pushes an element of n entries from `entry` on, which have one place. In the first block, where
    // no entry has pushed enough, `out` is left as it is, and no memory of earlier blocks is touched.
    template <class In>
    RTAMT_LOOP void push(std::uint64_t place, std::size_t entry, std::size_t n, In in,
                         View<Element> out) {
        if (block_ == 0) {
            for (std::size_t i = 0; i < n; ++i) out.put(i, in[i]);
            return;
        }
        const auto offset = static_cast<std::size_t>(place % block_);
        const std::size_t half = place / block_ % 2 * block_;
        const auto slot = [&](std::size_t k) RTAMT_LOOP_BODY {
            return slots_.at(kBlocks + k, entry);
        };
        const auto front = slot(half + offset);
        const auto oldest = offset + ahead_ == block_ ? slots_.at(kIdentity, entry)
                                                      : slot(half + offset + ahead_);
        const auto prefix = slots_.at(kPrefix, entry);
        if (place < block_) {
            RTAMT_INDEPENDENT
            for (std::size_t i = 0; i < n; ++i) {
                front.put(i, in[i]);
                prefix.put(i, F::combine(prefix[i], in[i]));
            }
            return;
        }
        const auto back = slot(block_ - half + (block_ - 1 - offset));
        const auto middle = slots_.at(kMiddle, entry);
        const auto suffix = slots_.at(kSuffix, entry);
        const auto run = [&]<bool kFresh>() RTAMT_LOOP_BODY {
            RTAMT_INDEPENDENT
            for (std::size_t i = 0; i < n; ++i) {
                const Element x = in[i];
                const Element first = oldest[i];
                front.put(i, x);
                const Element last = kFresh ? back[i] : F::combine(back[i], suffix[i]);
                back.put(i, last);
                suffix.put(i, last);
                const Element full = kFresh ? prefix[i] : middle[i];
                if (kFresh) middle.put(i, full);
                const Element newest = kFresh ? x : F::combine(prefix[i], x);
                prefix.put(i, newest);
                out.put(i, F::combine(F::combine(first, full), newest));
            }
        };
        offset == 0 ? run.template operator()<true>() : run.template operator()<false>();
    }

    void fields(Snapshot& s) { slots_.fields(s); }

private:
    static constexpr std::size_t kIdentity = 0, kMiddle = 1, kPrefix = 2, kSuffix = 3, kBlocks = 4;

    std::size_t block_;
    std::size_t ahead_;
    std::size_t num_;
    Slots<Element> slots_;
};

}  // namespace rtamt::batch
