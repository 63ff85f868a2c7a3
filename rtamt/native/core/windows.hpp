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
    void fields(Snapshot& s) override { s(total_); }

private:
    Element total_ = F::identity;
};

// The fold of the last `length` elements, 2 or more, in blocks of half that length: a two-stack
// queue whose flip is spread over the pushes, four combinations each, whatever the length.
//
// The window is the end of the block before the last one (its suffix folds are in front_), the
// whole last block (its fold is middle_) and the block being filled (its fold is prefix_). New
// elements replace those of front_ that have left the window, and each push turns one more element
// of back_, from its end on, into a suffix fold.
template <class F>
class SlidingWindow final : public Memory {
public:
    using Fold = F;
    using Element = typename F::Element;

    explicit SlidingWindow(std::size_t length)
        : block_(length / 2),
          ahead_(1 - length % 2),
          storage_(std::make_unique_for_overwrite<Element[]>(2 * (block_ + 1))) {
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
        if (++offset_ == block_) flip();
        return result;
    }

    void push(const double* a, const double* b, double* out, std::size_t n) {
        while (n > 0) {
            const std::size_t count = std::min(n, block_ - offset_);
            push_within_block(a, b, out, count);
            a += count;
            b += count;
            out += count;
            n -= count;
            offset_ += count;
            if (offset_ == block_) flip();
        }
    }

    std::size_t length() const { return 2 * block_ + 1 - ahead_; }

    void reset() override {
        offset_ = 0;
        front_ = storage_.get();
        back_ = front_ + block_ + 1;
        // This touches the memory too, so that no push waits for the operating system.
        std::fill_n(front_, 2 * (block_ + 1), F::identity);
        middle_ = prefix_ = suffix_ = F::identity;
    }

    void fields(Snapshot& s) override {
        std::size_t offset = offset_;
        s(offset);
        s.require(offset < block_);
        offset_ = offset;
        s.array(front_, block_);
        s.array(back_, block_);
        s(middle_, prefix_, suffix_);
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

    void flip() {
        std::swap(front_, back_);
        middle_ = prefix_;
        prefix_ = suffix_ = F::identity;
        offset_ = 0;
    }

    // Both halves are one element longer than the block: an identity, which is the oldest element
    // when the block of an even window is full.
    Element* front_;
    Element* back_;
    std::size_t offset_;
    std::size_t block_;
    std::size_t ahead_;
    Element middle_;
    Element prefix_;
    Element suffix_;
    std::unique_ptr<Element[]> storage_;
};

// The values of `length` samples ago; 0.0 at the first ones, which nobody reads.
class DelayLine final : public Memory {
public:
    explicit DelayLine(std::size_t length)
        : length_(length), ring_(std::make_unique<double[]>(length)) {}

    double push(double x) {
        const double late = ring_[place_];
        ring_[place_] = x;
        if (++place_ == length_) place_ = 0;
        return late;
    }

    void push(const double* in, double* out, std::size_t n) {
        if (n >= length_) {
            double* start = ring_.get();
            std::rotate(start, start + place_, start + length_);
            std::copy_n(start, length_, out);
            std::copy_n(in, n - length_, out + length_);
            std::copy_n(in + (n - length_), length_, start);
            place_ = 0;
            return;
        }
        const std::size_t first = std::min(n, length_ - place_);
        exchange(ring_.get() + place_, in, out, first);
        exchange(ring_.get(), in + first, out + first, n - first);
        place_ += n;
        if (place_ >= length_) place_ -= length_;
    }

    std::size_t length() const { return length_; }

    void reset() override {
        std::fill_n(ring_.get(), length_, 0.0);
        place_ = 0;
    }
    void fields(Snapshot& s) override {
        std::size_t place = place_;
        s(place);
        s.require(place < length_);
        place_ = place;
        s.array(ring_.get(), length_);
    }

private:
    static void exchange(double* __restrict ring, const double* __restrict in,
                         double* __restrict out, std::size_t n) {
        for (std::size_t i = 0; i < n; ++i) {
            out[i] = ring[i];
            ring[i] = in[i];
        }
    }

    std::size_t length_;
    std::size_t place_ = 0;
    std::unique_ptr<double[]> ring_;
};

}  // namespace rtamt
