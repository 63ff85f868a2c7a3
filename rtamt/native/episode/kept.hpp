// Folds of the settled elements of windows that are still open: of ever shorter stretches of time,
// all of which end now.
#pragma once

#include <algorithm>

#include "episode/streams.hpp"

namespace rtamt::episode {

template <class M>
class Kept {
public:
    using Element = typename M::Element;

    Kept() = default;
    explicit Kept(std::size_t corners) : lines_(corners, M::width) {}

    std::size_t size() const { return lines_.size(); }
    std::size_t corners() const { return lines_.corners(); }
    const double* results() const { return lines_.line(0, M::width - 1).data(); }
    double first(std::size_t corner) const { return lines_.line(corner, M::width - 1)[0]; }

    // Stretches that begin now, up to a number of all stretches.
    void extend(std::size_t size) {
        for (std::size_t c = 0; c < corners(); ++c)
            for (int k = 0; k < M::width; ++k)
                lines_.line(c, k).extend(size, component<M>(M::identity, k));
    }
    // A new element for the stretches from number `from` on.
    void fold_in(std::size_t corner, std::size_t from, Element x) {
        if (from >= size()) return;
        double* p = lines_.line(corner, 0).data() + from;
        double* q = lines_.line(corner, M::width - 1).data() + from;
        const std::size_t n = size() - from;
        if constexpr (M::width == 1) {
            move_last(p, n, [x](double y) { return M::combine(y, x); });
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

    // In a world, of the first `count`.
    Elements in_world(World w, std::size_t count, Desk& desk, Scratch* scratch) const {
        if (corners() == 1) return {lines_.line(0, 0).data(), results()};
        const Room<M> room(scratch[0], scratch[1], count);
        for (std::size_t i = 0; i < count; ++i) {
            room.p[i] = lines_.at(i, 0, w, desk.unknowns);
            if (M::width > 1) room.q[i] = lines_.at(i, 1, w, desk.unknowns);
        }
        return room.elements();
    }

    // Of all results in front of an element `tail`, and of some that were popped; of pairs, for
    // stretches of `until` and its dual only.
    Extremes extremes(Element tail) const {
        Extremes found = decided_results_;
        const std::size_t n = size();
        if (decided_ == n) return found;
        const double* p = lines_.line(0, 0).data();
        const double* q = results();
        const auto at = [&](std::size_t i) {
            return M::result(M::combine(get<M>(p, q, i), tail));
        };
        found.add(at(decided_));
        found.add(at(n - 1));
        if constexpr (kAhead) {  // what is reached falls, what can be reached rises
            std::size_t low = decided_;
            std::size_t high = n - 1;
            while (low < high) {
                const std::size_t middle = (low + high) / 2;
                const double limit = lower(p[middle], tail.q);
                if (upper(limit, q[middle]) == limit) {
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
    void save(Writer& out) const {
        lines_.save(out);
        out.put<std::uint64_t>(decided_);
        out.put(decided_results_);
    }
    void load(Reader& in, std::size_t size) {
        lines_.load(in, size);
        decided_ = in.get<std::uint64_t>();
        Reader::require(decided_ <= size);
        decided_results_ = in.get<Extremes>();
    }

private:
    static constexpr bool kAhead = M::kind == Kind::ahead;
    static constexpr std::size_t kChunk = 32;

    static double lower(double x, double y) {
        return M::combine({x, M::identity.q}, {y, M::identity.q}).p;
    }
    static double upper(double x, double y) {
        return M::combine({M::identity.p, x}, {M::identity.p, y}).q;
    }

    // Of numbers that rise, or that fall, those that are moved stand last.
    template <class Move>
    static void move_last(double* p, std::size_t n, Move move) {
        while (n > 0) {
            const std::size_t count = std::min(n, kChunk);
            double* last = p + (n - count);
            const bool more = move(*last) != *last;
            for (std::size_t i = 0; i < count; ++i) last[i] = move(last[i]);
            if (!more) return;
            n -= count;
        }
    }

    static void each(double* __restrict p, double* __restrict q, std::size_t n, Element x) {
        for (std::size_t i = 0; i < n; ++i) put<M>(p, q, i, M::combine(get<M>(p, q, i), x));
    }

    // In words for `until`: p rises with the begin of a stretch. Where it is not above the new q,
    // which is at the first stretches, it is reached and the result decided. Where it is above all
    // q that came, the result is the greatest of these, and falls. A new element thus moves the
    // last p and the last results alone.
    void reach(double* p, double* q, Element x) {
        const std::size_t n = size();
        while (decided_ < n && lower(p[decided_], x.q) == p[decided_]) {
            q[decided_] = upper(q[decided_], p[decided_]);
            decided_results_.add(q[decided_++]);
        }
        const std::size_t rest = n - decided_;
        move_last(q + decided_, rest, [x](double y) { return upper(y, x.q); });
        move_last(p + decided_, rest, [x](double y) { return lower(y, x.p); });
    }

    Polynomials lines_;
    std::size_t decided_ = 0;
    Extremes decided_results_;
};

}  // namespace rtamt::episode
