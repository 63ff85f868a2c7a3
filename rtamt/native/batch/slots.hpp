// Slots: each holds an element of every entry, as columns of the element's numbers.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdlib>
#include <memory>
#include <new>
#include <utility>

#include "core/columns.hpp"
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
        for (std::size_t k = 0; k < width; ++k)
            columns_[k][i] = is ? numbers[k] : columns_[k][i];
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

}  // namespace rtamt::batch
