// Partial folds: the folds of the settled elements of windows that are still open. The windows
// begin one after the other, and all of them reach to the present.
#pragma once

#include <algorithm>

#include "episode/streams.hpp"

namespace rtamt::episode {

template <class F>
class PartialFolds {
public:
    using Element = typename F::Element;

    PartialFolds() = default;
    explicit PartialFolds(std::size_t corners) : lines_(corners, F::width) {}

    std::size_t size() const { return lines_.size(); }
    std::size_t corners() const { return lines_.corners(); }
    const double* results() const { return lines_.line(0, F::width - 1).data(); }
    double first(std::size_t corner) const { return lines_.line(corner, F::width - 1)[0]; }

    // Adds windows without elements, up to a number of windows.
    void extend(std::size_t size) {
        for (std::size_t c = 0; c < corners(); ++c)
            for (int k = 0; k < F::width; ++k)
                lines_.line(c, k).extend(size, component<F>(F::identity, k));
    }
    // Adds an element to the windows from number `from` on.
    void fold_in(std::size_t corner, std::size_t from, Element x) {
        if (from >= size()) return;
        double* p = lines_.line(corner, 0).data() + from;
        double* q = lines_.line(corner, F::width - 1).data() + from;
        const std::size_t n = size() - from;
        if constexpr (F::width == 1) {
            move_last<F>(p, n, x);
        } else {
            if (kAhead && corners() == 1) {
                reach(p, q, x);
            } else {
                each(p, q, n, x);
            }
        }
    }
    void pop() {
        lines_.pop();
        if (decided_ > 0) --decided_;
    }

    // The folds of the first `count` windows in a world.
    Elements in_world(World w, std::size_t count, Workspace& workspace, Scratch* scratch) const {
        if (corners() == 1) return {lines_.line(0, 0).data(), results()};
        const ElementBuffer<F> buffer(scratch[0], scratch[1], count);
        for (std::size_t i = 0; i < count; ++i) {
            buffer.p[i] = lines_.at(i, 0, w, workspace.unknowns);
            if (F::width > 1) buffer.q[i] = lines_.at(i, 1, w, workspace.unknowns);
        }
        return buffer.elements();
    }

    // The extremes of the results of all windows, each followed by an element `tail`, and of some
    // windows that were popped. Not for `since` and its dual.
    Extremes extremes(Element tail) const {
        Extremes found = decided_results_;
        const std::size_t n = size();
        if (decided_ == n) return found;
        const double* p = lines_.line(0, 0).data();
        const double* q = results();
        const auto at = [&](std::size_t i) {
            return F::result(F::combine(get<F>(p, q, i), tail));
        };
        found.add(at(decided_));
        found.add(at(n - 1));
        if constexpr (kAhead) {  // what is reached falls, what can be reached rises
            std::size_t low = decided_;
            std::size_t high = n - 1;
            while (low < high) {
                const std::size_t middle = (low + high) / 2;
                const double limit = lower(p[middle], tail.q);
                if (same(upper(limit, q[middle]), limit)) {
                    high = middle;
                } else {
                    low = middle + 1;
                }
            }
            found.add(at(low));
            if (low > decided_) found.add(at(low - 1));
        }
        return found;
    }

    void substitute(std::size_t unknown, const double* value) { lines_.substitute(unknown, value); }
    void clear() {
        lines_.clear();
        decided_ = 0;
        decided_results_ = {};
    }
    void fields(Snapshot& s, std::size_t size) {
        lines_.fields(s, size);
        s(decided_, decided_results_);
        s.require(decided_ <= size);
    }

private:
    static constexpr bool kAhead = F::kind == Kind::ahead;
    static constexpr std::size_t kChunk = 32;

    static double lower(double x, double y) {
        return F::combine({x, F::identity.q}, {y, F::identity.q}).p;
    }
    static double upper(double x, double y) {
        return F::combine({F::identity.p, x}, {F::identity.p, y}).q;
    }

    // Moves the numbers, which rise or fall: those that change are the last ones.
    template <class G>
    static void move_last(double* p, std::size_t n, double x) {
        while (n > 0) {
            const std::size_t count = std::min(n, kChunk);
            double* last = p + (n - count);
            const bool more = !same(G::combine_alone(*last, x), *last);
            combine_results<G>({last, last}, Repeated<G>{x}, last, count);
            if (!more) return;
            n -= count;
        }
    }

    static void each(double* __restrict p, double* __restrict q, std::size_t n, Element x) {
        for (std::size_t i = 0; i < n; ++i) put<F>(p, q, i, F::combine(get<F>(p, q, i), x));
    }

    // Adds an element to all windows of `until` or its dual. In the words of `until`: the later a
    // window begins, the greater is its p. In the first windows p is not above the new q, and the
    // result is decided: no later q can change it. In the others p is above every q so far; their
    // results are the greatest of these and fall. So a new element changes only the last p and the
    // last results.
    void reach(double* p, double* q, Element x) {
        const std::size_t n = size();
        while (decided_ < n && same(lower(p[decided_], x.q), p[decided_])) {
            q[decided_] = upper(q[decided_], p[decided_]);
            decided_results_.add(q[decided_++]);
        }
        const std::size_t rest = n - decided_;
        move_last<typename F::UpperFold>(q + decided_, rest, x.q);
        move_last<typename F::LowerFold>(p + decided_, rest, x.p);
    }

    Polynomials lines_;
    std::size_t decided_ = 0;
    Extremes decided_results_;
};

}  // namespace rtamt::episode
