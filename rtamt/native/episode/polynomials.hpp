// Settled values of the episode machine: lattice polynomials in the values that are unknown yet.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/arrays.hpp"
#include "core/snapshot.hpp"

namespace rtamt {

// A queue of numbers that are always contiguous. It grows with what it holds, so that a long window
// costs nothing before it is full, and by doubling, so that a full one allocates nothing: when the
// numbers reach the end of the memory, they move to its front.
class Line {
public:
    std::size_t size() const { return end_ - begin_; }
    double* data() { return storage_.get() + begin_; }
    const double* data() const { return storage_.get() + begin_; }
    double& operator[](std::size_t i) { return data()[i]; }
    double operator[](std::size_t i) const { return data()[i]; }
    double back() const { return storage_[end_ - 1]; }

    void push(double x) {
        if (end_ == capacity_) [[unlikely]]
            make_room(1);
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

namespace rtamt::episode {

// What the rest of the episode is assumed to be: none (it ends now), or the worst, or the best. The
// others are found when a trace is cut: the worst and best anew, and the worst and best if cut.
enum World : int { kNow, kLower, kUpper, kOpenLower, kOpenUpper, kCutLower, kCutUpper };
constexpr int kWorlds = 7;
constexpr World kAll[] = {kNow, kLower, kUpper};
constexpr World kAtEnd[] = {kOpenLower, kOpenUpper, kCutLower, kCutUpper};
constexpr World kCut[] = {kCutLower, kCutUpper};
// There are unseen samples.
constexpr World kAhead[] = {kLower, kUpper, kOpenLower, kOpenUpper, kCutLower, kCutUpper};
constexpr bool at_end(World w) { return w >= kOpenLower; }
constexpr bool is_cut(World w) { return w >= kCutLower; }
constexpr bool is_upper(World w) { return w == kUpper || w == kOpenUpper || w == kCutUpper; }
// The open world that a world of a cut trace goes over to where nothing was recorded.
constexpr World open_of(World w) { return w == kCutLower ? kOpenLower : kOpenUpper; }

constexpr std::size_t kMaxUnknowns = 8;
constexpr std::size_t kMaxCorners = std::size_t{1} << kMaxUnknowns;

// The unknowns of a machine and their values in every world. A polynomial is stored by its values
// at the corners: bit k of a corner says that unknown k is +inf there, else it is -inf.
struct Unknowns {
    std::size_t count = 0;
    std::array<std::array<double, kMaxUnknowns>, kWorlds> values{};

    // The number of corners of a polynomial: 1 if the mask names no unknown, else 2^count.
    std::size_t corners(std::uint32_t mask) const {
        return mask == 0 ? 1 : std::size_t{1} << count;
    }
    // The value of a polynomial in a world; overwrites the corners.
    double in_world(World w, double* corners) const {
        std::size_t half = std::size_t{1} << count;
        for (std::size_t k = count; k-- > 0;) {
            half /= 2;
            const double u = values[w][k];
            for (std::size_t c = 0; c < half; ++c)
                corners[c] = alone::greater(corners[c], alone::lesser(corners[c + half], u));
        }
        return corners[0];
    }
};

// A queue of elements of `width` components, each component a polynomial.
class Polynomials {
public:
    Polynomials() = default;
    Polynomials(std::size_t corners, std::size_t width)
        : corners_(corners), width_(width), lines_(corners * width) {}

    Line& line(std::size_t corner, std::size_t component = 0) {
        return lines_[component * corners_ + corner];
    }
    const Line& line(std::size_t corner, std::size_t component = 0) const {
        return lines_[component * corners_ + corner];
    }
    std::size_t size() const { return lines_[0].size(); }
    std::size_t corners() const { return corners_; }

    void pop() {
        for (Line& line : lines_) line.pop();
    }
    void clear() {
        for (Line& line : lines_) line.clear();
    }
    // A component of element i in a world.
    double at(std::size_t i, std::size_t component, World w, const Unknowns& unknowns) const {
        if (corners_ == 1) return line(0, component)[i];
        std::array<double, kMaxCorners> corners;  // written as far as they are read
        for (std::size_t c = 0; c < corners_; ++c) corners[c] = line(c, component)[i];
        return unknowns.in_world(w, corners.data());
    }
    // Replaces an unknown by its value at every corner, one sample later.
    void substitute(std::size_t unknown, const double* value);

    void fields(Snapshot& s, std::size_t size) {
        for (Line& line : lines_) line.fields(s, size);
    }

private:
    std::size_t corners_ = 0;
    std::size_t width_ = 0;
    std::vector<Line> lines_;
};

// The fold of all settled elements, as a polynomial.
template <class F>
class SettledFold {
public:
    using Element = typename F::Element;

    explicit SettledFold(std::size_t corners) : totals_(corners, F::identity) {}

    std::size_t corners() const { return totals_.size(); }
    Element operator[](std::size_t corner) const { return totals_[corner]; }
    void add(std::size_t corner, Element x) {
        totals_[corner] = F::combine_alone(totals_[corner], x);
    }

    Element in_world(World w, const Unknowns& unknowns) const {
        if (corners() == 1) return totals_[0];
        const auto at = [&](int k) {
            std::array<double, kMaxCorners> values;
            for (std::size_t c = 0; c < corners(); ++c) values[c] = component<F>(totals_[c], k);
            return unknowns.in_world(w, values.data());
        };
        return F::element(at(0), at(F::width - 1));
    }
    void substitute(std::size_t unknown, const double* value) {
        const std::size_t bit = std::size_t{1} << unknown;
        for (std::size_t c = 0; c < corners(); ++c) {
            if (c & bit) continue;
            const Element low = totals_[c];
            const Element high = totals_[c | bit];
            for (const std::size_t corner : {c, c | bit}) {
                const auto at = [&](int k) {
                    return greater(component<F>(low, k),
                                   lesser(component<F>(high, k), value[corner]));
                };
                totals_[corner] = F::element(at(0), at(F::width - 1));
            }
        }
    }

    void reset() { std::fill(totals_.begin(), totals_.end(), F::identity); }
    void fields(Snapshot& s) { s.array(totals_.data(), totals_.size()); }

private:
    std::vector<Element> totals_;  // at every corner
};

}  // namespace rtamt::episode
