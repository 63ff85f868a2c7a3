// The other streams that read streams: pointwise, over all of the past, over all of the future.
#pragma once

#include "episode/streams.hpp"

namespace rtamt::episode {

// The least or greatest of two operands at one time.
template <class M>
class PointwiseStream final : public Stream {
public:
    PointwiseStream(Desk& desk, Stream& a, Stream& b)
        : Stream(desk, std::max(a.late(), b.late()), a.speaks_of() | b.speaks_of()), a_(a), b_(b) {
        for (World w : {kLower, kUpper}) {
            Outlook& o = outlook_[w];
            const Outlook& x = a.outlook(w);
            const Outlook& y = b.outlook(w);
            o = {std::max(x.reach, y.reach), std::max(x.floor, y.floor), x.certain && y.certain,
                 M::combine(x.tail, y.tail)};
            for (const Outlook& operand : {x, y}) {
                if (!operand.certain || operand.tail != -M::identity) continue;
                o.reach = std::min(o.reach, operand.reach);
                o.certain = true;
                o.tail = operand.tail;
            }
            o.reach = std::max(o.reach, -late_);
        }
    }

    void prepare() override {
        for (Stream* s : {&a_, &b_}) s->hold(late_ - s->late() + 1);
    }
    void demand() override {
        for (Stream* s : {&a_, &b_}) {
            if (alive()) s->enliven();
            for (World w : kAll)
                if (looks(w)) s->want(w);
        }
    }

    void settle(Time t, const double*) override {
        if (t < late_) return;
        last_ = t - late_;
        for (std::size_t c = 0; c < corners(); ++c)
            append(c, M::combine(a_.settled(last_, c), b_.settled(last_, c)));
    }

    void look(World w, Time t) override {
        if (!outlook_[w].certain) tail_[w] = M::combine(a_.tail(w), b_.tail(w));
        const Time first = last_ + 1;
        const Time end = this->end(w, t);
        if (end < first) {
            open_[w] = {};
            return;
        }
        const double* x = a_.values(w, first, end, desk_.scratch[0]);
        const double* y = b_.values(w, first, end, desk_.scratch[1]);
        const auto count = static_cast<std::size_t>(end - first + 1);
        double* __restrict out = open(w, count);
        for (std::size_t i = 0; i < count; ++i) out[i] = M::combine(x[i], y[i]);
    }

private:
    Stream& a_;
    Stream& b_;
};

// The fold over all offsets up to hi.
template <class M>
class RunningStream final : public Stream {
public:
    using Element = typename M::Element;

    RunningStream(Desk& desk, Time hi, Stream& p, Stream& q)
        : RunningStream(desk, hi, Operands<M>(p, q)) {}

    void prepare() override {
        in_.hold(late_, hi_);
        total_ = Polynomials(corners(), M::width);
        reset();
    }
    void demand() override {
        if (alive()) in_.enliven();
        for (World w : kAll)
            if (looks(w)) in_.want(w);
    }

    void settle(Time t, const double*) override {
        if (t < late_) return;
        last_ = t - late_;
        const Time newest = last_ + hi_;
        for (std::size_t c = 0; c < corners(); ++c) {
            Line& p = total_.line(c, 0);
            Line& q = total_.line(c, M::width - 1);
            Element x = get<M>(p.data(), q.data(), 0);
            if (newest >= 0) {
                x = M::combine(x, in_.settled(newest, c));
                put<M>(p.data(), q.data(), 0, x);
            }
            append(c, M::result(x));
        }
    }

    void look(World w, Time t) override {
        const Time first = last_ + 1;
        const Time end = std::max(first - 1, this->end(w, t));
        Element x = M::element(total_.at(0, 0, w, desk_.unknowns),
                               total_.at(0, M::width - 1, w, desk_.unknowns));
        const auto count = static_cast<std::size_t>(end - first + 1);
        double* out = open(w, count);
        const Time empty_to = std::min(-hi_ - 1, end);  // times whose window lies before time 0
        const Time start = std::max(first, empty_to + 1);
        std::fill(out, out + (start - first), M::result(x));
        if (start <= end) {
            const Elements in = in_.values(w, start + hi_, end + hi_, &desk_.scratch[0]);
            out += start - first;
            for (std::size_t i = 0; i < static_cast<std::size_t>(end - start + 1); ++i) {
                x = M::combine(x, get<M>(in.p, in.q, i));
                out[i] = M::result(x);
            }
        }
        if (!outlook_[w].certain) tail_[w] = M::result(M::combine(x, in_.tail(w)));
    }

    void substitute(std::size_t unknown, const double* value) override {
        Stream::substitute(unknown, value);
        total_.substitute(unknown, value);
    }
    void reset() override {
        Stream::reset();
        total_.clear();
        for (std::size_t c = 0; c < corners(); ++c) {
            for (int k = 0; k < M::width; ++k) total_.line(c, k).extend(1, 0.0);
            put<M>(total_.line(c, 0).data(), total_.line(c, M::width - 1).data(), 0, M::identity);
        }
    }
    void save(Writer& out) const override {
        Stream::save(out);
        total_.save(out);
    }
    void load(Reader& in, Time t) override {
        Stream::load(in, t);
        total_.load(in, 1);
    }

private:
    RunningStream(Desk& desk, Time hi, Operands<M> in)
        : Stream(desk, std::max<Time>(0, in.late() + hi), in.speaks_of()), in_(in), hi_(hi) {
        for (World w : {kLower, kUpper})
            outlook_[w] = {std::max(-late_, in.reach(w) - hi),
                           std::max({Time{-1}, in.floor(w) - hi, -hi - 1}), in.absorbs(w),
                           in.tail_of_tails(w)};
    }

    Operands<M> in_;
    Time hi_;
    Polynomials total_;
};

// A stream that never settles but for an unknown, which is its value at the first open time.
class Endless : public Stream {
public:
    Endless(Desk& desk, Time late, std::uint32_t speaks_of, std::size_t unknown)
        : Stream(desk, late, speaks_of | std::uint32_t{1} << unknown), unknown_(unknown) {}

    // The unknown is value() of what it is one sample later, once there is a settled one;
    // append() is called when everybody has replaced it.
    std::size_t unknown() const { return unknown_; }
    bool has_settled() const { return last_ >= 0; }
    const double* value() const { return value_.data(); }
    void append() {
        for (std::size_t c = 0; c < corners(); ++c) Stream::append(c, value_[c]);
    }

protected:
    const std::size_t unknown_;
    std::array<double, kMaxCorners> value_{};
};

// The fold over all offsets from 0 on.
template <class M>
class EndlessStream final : public Endless {
public:
    using Element = typename M::Element;

    EndlessStream(Desk& desk, std::size_t unknown, Stream& p, Stream& q)
        : EndlessStream(desk, unknown, Operands<M>(p, q)) {}

    void prepare() override { in_.hold(late_, 0); }
    void demand() override {
        if (alive()) in_.enliven();
        for (World w : kAll)
            if (looks(w)) in_.want(w);
    }

    void settle(Time t, const double*) override {
        if (t < late_) return;
        last_ = t - late_;
        for (std::size_t c = 0; c < corners(); ++c) {
            const double u = c >> unknown_ & 1 ? kInfinity : -kInfinity;
            Element rest = M::identity;
            if constexpr (M::width == 1) {
                rest = u;
            } else {
                rest.q = u;
            }
            value_[c] = M::result(M::combine(in_.settled(last_, c), rest));
        }
    }

    void reset() override {
        Stream::reset();
        for (World w : kAll)
            desk_.unknowns.values[w][unknown_] = w == kNow ? M::result(M::identity) : tail_[w];
    }

    void look(World w, Time t) override {
        const Element tail = in_.tail(w);
        tail_[w] = M::result(M::combine(tail, tail));
        const Time first = last_ + 1;
        const Time end = std::max(first - 1, this->end(w, t));
        const auto count = static_cast<std::size_t>(end - first + 1);
        double* out = open(w, count);
        Element x = tail;
        if (count > 0) {
            const Elements in = in_.values(w, first, end, &desk_.scratch[0]);
            for (std::size_t i = count; i-- > 0;) {
                x = M::combine(get<M>(in.p, in.q, i), x);
                out[i] = M::result(x);
            }
        }
        desk_.unknowns.values[w][unknown_] = M::result(x);
    }

private:
    EndlessStream(Desk& desk, std::size_t unknown, Operands<M> in)
        : Endless(desk, in.late(), in.speaks_of(), unknown), in_(in) {
        for (World w : {kLower, kUpper})
            outlook_[w] = {in.absorbs(w) ? -late_ : in.reach(w), in.floor(w), in.certain(w),
                           in.tail_of_tails(w)};
    }

    Operands<M> in_;
};

}  // namespace rtamt::episode
