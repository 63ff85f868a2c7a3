// Line: a queue of numbers that are always contiguous.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>

#include "core/snapshot.hpp"

namespace rtamt {

// Grows with what it holds, so that a long window costs nothing before it is full, and by doubling,
// so that a full one allocates nothing: when the numbers reach the end of the memory, they move to
// its front.
class Line {
public:
    std::size_t size() const { return end_ - begin_; }
    double* data() { return storage_.get() + begin_; }
    const double* data() const { return storage_.get() + begin_; }
    double& operator[](std::size_t i) { return data()[i]; }
    double operator[](std::size_t i) const { return data()[i]; }
    double back() const { return storage_[end_ - 1]; }

    void push(double x) {
        if (end_ == capacity_) [[unlikely]] make_room(1);
        storage_[end_++] = x;
    }
    void pop() { ++begin_; }
    void extend(std::size_t size, double x) {
        if (size <= this->size()) return;
        const std::size_t more = size - this->size();
        if (capacity_ - end_ < more) make_room(more);
        std::fill_n(storage_.get() + end_, more, x);
        end_ += more;
    }
    void clear() { begin_ = end_ = 0; }

    void fields(Snapshot& s, std::size_t size) {
        if (s.reads()) {
            s.require_unread<double>(size);
            clear();
            extend(size, 0.0);
        }
        s.array(data(), size);
    }

private:
    void make_room(std::size_t more) {
        const std::size_t size = this->size();
        if (begin_ >= size + more) {
            std::copy_n(data(), size, storage_.get());
        } else {
            capacity_ = 2 * (size + more) + 6;
            auto larger = std::make_unique_for_overwrite<double[]>(capacity_);
            std::copy_n(data(), size, larger.get());
            storage_ = std::move(larger);
        }
        begin_ = 0;
        end_ = size;
    }

    std::unique_ptr<double[]> storage_;
    std::size_t capacity_ = 0;
    std::size_t begin_ = 0;
    std::size_t end_ = 0;
};

}  // namespace rtamt
