// What instructions remember: folds of the last elements of a signal, and delays. All take one
// element or a block of them. The definition is rtamt/machines/windows.py.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "core/folds.hpp"
#include "core/snapshot.hpp"

namespace rtamt {

// The memory of one instruction. Functions that are called seldom are virtual; pushes are not, as
// the opcode says the class.
class Memory {
public:
    Memory() = default;
    Memory(const Memory&) = delete;
    Memory& operator=(const Memory&) = delete;
    virtual ~Memory() = default;

    virtual void reset() = 0;
    virtual void fields(Snapshot& s) = 0;
};

// The fold of the last element: the element itself.
template <class F>
class LatestWindow final : public Memory {
public:
    using Fold = F;
    using Element = typename F::Element;

    Element push(Element x) { return x; }
    void push(const double* a, const double* b, double* out, std::size_t n) {
        for (std::size_t i = 0; i < n; ++i) out[i] = F::result(F::element(a[i], b[i]));
    }
    void reset() override {}
    void fields(Snapshot&) override {}
};

// The fold of all elements so far.
template <class F>
class RunningWindow final : public Memory {
public:
    using Fold = F;
    using Element = typename F::Element;

    Element push(Element x) { return total_ = F::combine_alone(total_, x); }
    void push(const double* a, const double* b, double* out, std::size_t n) {
        Element total = total_;
        for (std::size_t i = 0; i < n; ++i) {
            total = F::combine_alone(total, F::element(a[i], b[i]));
            out[i] = F::result(total);
        }
        total_ = total;
    }
    void reset() override { total_ = F::identity; }
    void fields(Snapshot& s) override { s.numbers(&total_, 1); }

private:
    Element total_ = F::identity;
};

// The fold of the last `length` elements, 2 or more, in blocks of half that length: a two-stack
// queue whose flip is spread over the pushes, four combinations each, whatever the length.
//
// The window is the end of the block before the last one (its suffix folds are in front_), the
// whole last block (its fold is middle_) and the block being filled (its fold is prefix_). New
// elements replace elements of front_ that have left the window, and each push turns one more
// element of back_, from its end on, into a suffix fold.
//
// The memory is large, and a new window is full of identities: they are written a few at a time
// ahead of the pushes of the first block, so that what no sample reaches is never touched.
template <class F>
class SlidingWindow final : public Memory {
public:
    using Fold = F;
    using Element = typename F::Element;

    explicit SlidingWindow(std::size_t length)
        : block_(length / 2),
          ahead_(1 - length % 2),
          storage_(std::make_unique_for_overwrite<Element[]>(2 * (block_ + 1))) {
        storage_[block_] = storage_[2 * block_ + 1] = F::identity;
        reset();
    }

    Element push(Element x) {
        Element* front = front_ + offset_;
        Element* back = back_ + (block_ - 1 - offset_);
        const Element oldest = front[ahead_];
        *front = x;
        suffix_ = *back = F::combine_alone(*back, suffix_);
        prefix_ = F::combine_alone(prefix_, x);
        const Element result = F::combine_alone(F::combine_alone(oldest, middle_), prefix_);
        if (++offset_ == limit_) go_on();
        return result;
    }

    void push(const double* a, const double* b, double* out, std::size_t n) {
        while (n > 0) {
            const std::size_t count = std::min(n, limit_ - offset_);
            push_within_block(a, b, out, count);
            a += count;
            b += count;
            out += count;
            n -= count;
            offset_ += count;
            if (offset_ == limit_) go_on();
        }
    }

    std::size_t length() const { return 2 * block_ + 1 - ahead_; }

    void reset() override {
        offset_ = 0;
        front_ = storage_.get();
        back_ = front_ + block_ + 1;
        middle_ = prefix_ = suffix_ = F::identity;
        fill();
    }

    void fields(Snapshot& s) override {
        std::size_t offset = offset_;
        std::size_t limit = limit_;
        s(offset, limit);
        s.require(offset < limit && limit <= block_);
        s.numbers(front_, limit);
        s.numbers(back_ + (block_ - limit), limit);
        front_[limit] = F::identity;
        offset_ = offset;
        limit_ = limit;
        s.numbers(&middle_, 1);
        s.numbers(&prefix_, 1);
        s.numbers(&suffix_, 1);
    }

private:
    void push_within_block(const double* __restrict a, const double* __restrict b,
                           double* __restrict out, std::size_t count) {
        Element* __restrict front = front_ + offset_;
        Element* __restrict back = back_ + (block_ - 1 - offset_);
        const std::size_t ahead = ahead_;
        const Element middle = middle_;
        Element prefix = prefix_;
        Element suffix = suffix_;
        for (std::size_t i = 0; i < count; ++i) {
            const Element x = F::element(a[i], b[i]);
            const Element oldest = front[i + ahead];
            front[i] = x;
            suffix = *back = F::combine_alone(*back, suffix);
            --back;
            prefix = F::combine_alone(prefix, x);
            out[i] = F::result(F::combine_alone(F::combine_alone(oldest, middle), prefix));
        }
        prefix_ = prefix;
        suffix_ = suffix;
    }

    // Begins the next block, or goes on in the first one.
    void go_on() {
        if (offset_ < block_) return fill();
        std::swap(front_, back_);
        middle_ = prefix_;
        prefix_ = suffix_ = F::identity;
        offset_ = 0;
    }

    // Writes the identities that the next pushes of the first block read.
    void fill() {
        limit_ = offset_ + std::min(kFilled, block_ - offset_);
        std::fill(front_ + offset_, front_ + limit_ + 1, F::identity);
        std::fill(back_ + (block_ - limit_), back_ + (block_ - offset_), F::identity);
    }

    static constexpr std::size_t kFilled = 16;

    // Both halves are one element longer than the block: an identity, which is the oldest element
    // when the block of an even window is full.
    Element* front_;
    Element* back_;
    std::size_t offset_;
    std::size_t
        limit_;  // the offset at which a push has more to do: block_, but in the first block
    std::size_t block_;
    std::size_t ahead_;
    Element middle_;
    Element prefix_;
    Element suffix_;
    std::unique_ptr<Element[]> storage_;
};

// The values of `length` samples ago; 0.0 at the first ones, which nobody reads. The memory is
// written as in a SlidingWindow.
class DelayLine final : public Memory {
public:
    explicit DelayLine(std::size_t length)
        : length_(length), ring_(std::make_unique_for_overwrite<double[]>(length)) {
        reset();
    }

    double push(double x) {
        const double late = ring_[place_];
        ring_[place_] = x;
        if (++place_ == limit_) go_on();
        return late;
    }

    void push(const double* in, double* out, std::size_t n) {
        while (n > 0) {
            const std::size_t count = std::min(n, limit_ - place_);
            exchange(ring_.get() + place_, in, out, count);
            in += count;
            out += count;
            n -= count;
            place_ += count;
            if (place_ == limit_) go_on();
        }
    }

    std::size_t length() const { return length_; }

    void reset() override {
        place_ = 0;
        fill();
    }
    void fields(Snapshot& s) override {
        std::size_t place = place_;
        std::size_t limit = limit_;
        s(place, limit);
        s.require(place < limit && limit <= length_);
        s.numbers(ring_.get(), limit);
        place_ = place;
        limit_ = limit;
    }

private:
    static void exchange(double* __restrict ring, const double* __restrict in,
                         double* __restrict out, std::size_t n) {
        for (std::size_t i = 0; i < n; ++i) {
            out[i] = ring[i];
            ring[i] = in[i];
        }
    }

    void go_on() {
        if (place_ < length_) return fill();
        place_ = 0;
    }
    void fill() {
        limit_ = place_ + std::min(kFilled, length_ - place_);
        std::fill(ring_.get() + place_, ring_.get() + limit_, 0.0);
    }

    static constexpr std::size_t kFilled = 16;

    std::size_t length_;
    std::size_t place_;
    std::size_t limit_;
    std::unique_ptr<double[]> ring_;
};

}  // namespace rtamt
