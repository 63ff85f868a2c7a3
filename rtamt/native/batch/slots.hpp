// Slots: each holds an element of every entry, as columns of the element's numbers; and the folds
// of the last elements of every entry.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>
#include <utility>

#include "core/columns.hpp"
#include "core/folds.hpp"
#include "core/snapshot.hpp"

namespace rtamt::batch {

// Numbers, 0.0 at first. The operating system gives the memory when it is first written to.
class Numbers {
public:
    explicit Numbers(std::size_t size) : size_(size) { clear(); }
    void clear() {
        data_.reset(static_cast<double*>(std::calloc(size_ + 1, sizeof(double))));
        if (!data_) throw std::bad_alloc();
    }
    double* data() { return data_.get(); }
    const double* data() const { return data_.get(); }

    void fields(Snapshot& s) {
        s.array(data(), size_);
        s.require(columns::first_nan(data(), size_) == size_);
    }

private:
    struct Free {
        void operator()(double* data) const { std::free(data); }
    };
    std::size_t size_;
    std::unique_ptr<double[], Free> data_;
};

// The elements of a slot from an entry on. An element is a struct of doubles, or a double.
template <class Element>
class View {
public:
    static constexpr std::size_t width = sizeof(Element) / sizeof(double);
    using Doubles = std::array<double, width>;

    View(double* start, std::size_t stride) {
        for (std::size_t k = 0; k < width; ++k) columns_[k] = start + k * stride;
    }
    View from(std::size_t i) const {
        View later = *this;
        for (double*& column : later.columns_) column += i;
        return later;
    }
    Element operator[](std::size_t i) const {
        Doubles numbers;
        for (std::size_t k = 0; k < width; ++k) numbers[k] = columns_[k][i];
        return std::bit_cast<Element>(numbers);
    }
    void put(std::size_t i, Element x) const {
        const auto numbers = std::bit_cast<Doubles>(x);
        for (std::size_t k = 0; k < width; ++k) columns_[k][i] = numbers[k];
    }
    // Puts an element if it is so; without a branch, so that loops become vectors.
    void put_if(bool is, std::size_t i, Element x) const {
        const auto numbers = std::bit_cast<Doubles>(x);
        for (std::size_t k = 0; k < width; ++k) columns_[k][i] = is ? numbers[k] : columns_[k][i];
    }

private:
    std::array<double*, width> columns_;
};

template <class Element>
class Slots {
public:
    // Columns are a cache line longer than they need: at a power of two from each other, those that
    // a loop reads would fall on the same lines of the cache.
    Slots(std::size_t slots, std::size_t num)
        : stride_((num + 7) / 8 * 8 + 8), numbers_(View<Element>::width * slots * stride_) {}

    View<Element> at(std::size_t slot, std::size_t entry = 0) {
        return {numbers_.data() + View<Element>::width * slot * stride_ + entry, stride_};
    }
    void clear() { numbers_.clear(); }
    void fields(Snapshot& s) { numbers_.fields(s); }

private:
    std::size_t stride_;
    Numbers numbers_;
};

// The fold of the last `length` elements of every entry, 1 or more: SlidingWindow in columns. What
// it gives is right for entries that have pushed so many, whatever the slots held before: an entry
// that begins anew clears nothing.
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

    // Pushes an element of n entries from `entry` on, which have one place. In the first block,
    // where no entry has pushed enough, `out` is left as it is, and no memory of earlier blocks is
    // touched.
    template <class In>
    RTAMT_LOOP void push(std::uint64_t place, std::size_t entry, std::size_t n, In in,
                         View<Element> out) {
        if (block_ == 0) {
            for (std::size_t i = 0; i < n; ++i) out.put(i, in[i]);
            return;
        }
        const auto offset = static_cast<std::size_t>(place % block_);
        const std::size_t half = place / block_ % 2 * block_;
        const auto slot = [&](std::size_t k)
                              RTAMT_LOOP_BODY { return slots_.at(kBlocks + k, entry); };
        const auto front = slot(half + offset);
        const auto oldest =
            offset + ahead_ == block_ ? slots_.at(kIdentity, entry) : slot(half + offset + ahead_);
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
