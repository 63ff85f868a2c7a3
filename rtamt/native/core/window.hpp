// The parts of a machine that remember: folds over the last elements of a stream, and delays.
// rtamt/windows.py is the definition. All take one element, or a block of them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "core/folds.hpp"
#include "core/snapshot.hpp"

namespace rtamt {

// What is done seldom is virtual. Pushes are not: the opcode names the class.
class Part {
public:
    Part() = default;
    Part(const Part&) = delete;
    Part& operator=(const Part&) = delete;
    virtual ~Part() = default;

    virtual void reset() = 0;
    virtual void save(Writer& out) const = 0;
    virtual void load(Reader& in) = 0;
};

// A window of one element.
template <class M>
class Latest final : public Part {
public:
    using Monoid = M;
    using Element = typename M::Element;

    Element push(Element x) { return x; }
    void push(const double* a, const double* b, double* out, std::size_t n) {
        for (std::size_t i = 0; i < n; ++i) out[i] = M::result(M::element(a[i], b[i]));
    }
    void reset() override {}
    void save(Writer&) const override {}
    void load(Reader&) override {}
};

// The fold of everything so far.
template <class M>
class Running final : public Part {
public:
    using Monoid = M;
    using Element = typename M::Element;

    Element push(Element x) { return total_ = M::combine(total_, x); }
    void push(const double* a, const double* b, double* out, std::size_t n) {
        Element total = total_;
        for (std::size_t i = 0; i < n; ++i) {
            total = M::combine(total, M::element(a[i], b[i]));
            out[i] = M::result(total);
        }
        total_ = total;
    }
    void reset() override { total_ = M::identity; }
    void save(Writer& out) const override { out.put(total_); }
    void load(Reader& in) override { total_ = in.get<Element>(); }

private:
    Element total_ = M::identity;
};

// The fold of the last `length` elements, 2 or more, in blocks of half that length: a two-stack
// queue whose flip is spread over the pushes, four combinations each, whatever the length.
//
// The window is the end of the block before the last one (its suffix folds stand in front_), the
// whole last block (its fold is middle_) and the block being filled (prefix_). While a block is
// filled, into the places of front_ that are consumed, the last block in back_ is turned into
// suffix folds from its end, one a push.
template <class M>
class Sliding final : public Part {
public:
    using Monoid = M;
    using Element = typename M::Element;

    explicit Sliding(std::size_t length)
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
        suffix_ = *back = M::combine(*back, suffix_);
        prefix_ = M::combine(prefix_, x);
        const Element result = M::combine(M::combine(oldest, middle_), prefix_);
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

    void reset() override {
        offset_ = 0;
        front_ = storage_.get();
        back_ = front_ + block_ + 1;
        // This touches the memory too, so that no push waits for the operating system.
        std::fill_n(front_, 2 * (block_ + 1), M::identity);
        middle_ = prefix_ = suffix_ = M::identity;
    }

    void save(Writer& out) const override {
        out.put<std::uint64_t>(offset_);
        out.put(front_, block_);
        out.put(back_, block_);
        out.put(middle_);
        out.put(prefix_);
        out.put(suffix_);
    }

    void load(Reader& in) override {
        const auto offset = in.get<std::uint64_t>();
        Reader::require(offset < block_);
        in.get(front_, block_);
        in.get(back_, block_);
        offset_ = offset;
        middle_ = in.get<Element>();
        prefix_ = in.get<Element>();
        suffix_ = in.get<Element>();
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
            const Element x = M::element(a[i], b[i]);
            const Element oldest = front[i + ahead];
            front[i] = x;
            suffix = *back = M::combine(*back, suffix);
            --back;
            prefix = M::combine(prefix, x);
            out[i] = M::result(M::combine(M::combine(oldest, middle), prefix));
        }
        prefix_ = prefix;
        suffix_ = suffix;
    }

    void flip() {
        std::swap(front_, back_);
        middle_ = prefix_;
        prefix_ = suffix_ = M::identity;
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

// A stream, `length` samples late; 0.0 before that, which nobody reads.
class Delay final : public Part {
public:
    explicit Delay(std::size_t length)
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

    void reset() override {
        std::fill_n(ring_.get(), length_, 0.0);
        place_ = 0;
    }
    void save(Writer& out) const override {
        out.put<std::uint64_t>(place_);
        out.put(ring_.get(), length_);
    }
    void load(Reader& in) override {
        const auto place = in.get<std::uint64_t>();
        Reader::require(place < length_);
        in.get(ring_.get(), length_);
        place_ = place;
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
