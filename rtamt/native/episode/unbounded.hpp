// Streams of operators without a bound: folds over all of the past, or over all of the future.
#pragma once

#include "episode/streams.hpp"

namespace rtamt::episode {

// At every time, the fold over all offsets up to hi.
template <class F>
class UnboundedPastStream final : public Stream {
public:
    using Element = typename F::Element;

    UnboundedPastStream(Workspace& workspace, Operands<F> in, Time hi)
        : Stream(workspace, std::max<Time>(0, in.latency() + hi), in.unknown_mask(), in.streams()),
          in_(in),
          hi_(hi),
          total_(corners()) {
        for (World w : kAhead)
            outlook_[w] = {std::max(-latency_, in.reach(w) - hi),
                           std::max({Time{-1}, in.floor(w) - hi, -hi - 1}), in.absorbs(w),
                           in.tail_of_tails(w)};
    }

    void prepare() override { in_.retain(latency_, hi_); }

    void settle(Time t, const double*) override {
        if (t < latency_) return;
        last_ = t - latency_;
        const Time newest = last_ + hi_;
        for (std::size_t c = 0; c < corners(); ++c) {
            if (newest >= 0) total_.add(c, in_.settled(newest, c));
            append(c, F::result(total_[c]));
        }
    }

    void find_open(World w, Time t) override {
        const Time first = last_ + 1;
        const std::size_t count = open_count(w, t);
        const Time end = last_ + static_cast<Time>(count);
        Element x = total_.in_world(w, workspace_.unknowns);
        double* out = open(w, count);
        const Time empty_to = std::min(-hi_ - 1, end);  // times whose window lies before time 0
        const Time start = std::max(first, empty_to + 1);
        std::fill(out, out + (start - first), F::result(x));
        if (start <= end) {
            const Elements in = in_.values(w, start + hi_, end + hi_, &workspace_.scratch[0]);
            out += start - first;
            for (std::size_t i = 0; i < static_cast<std::size_t>(end - start + 1); ++i) {
                x = F::combine_alone(x, get<F>(in.p, in.q, i));
                out[i] = F::result(x);
            }
        }
        if (!outlook_[w].certain) tail_[w] = F::result(F::combine_alone(x, in_.tail(w)));
    }

    void substitute(std::size_t unknown, const double* value) override {
        Stream::substitute(unknown, value);
        total_.substitute(unknown, value);
    }
    void reset() override {
        Stream::reset();
        total_.reset();
    }
    void fields(Snapshot& s, Time t) override {
        Stream::fields(s, t);
        total_.fields(s);
    }

private:
    Operands<F> in_;
    Time hi_;
    SettledFold<F> total_;
};

// A stream whose value at the first open time is an unknown, on which the settled values depend.
class UnsettledStream : public Stream {
public:
    UnsettledStream(Workspace& workspace, Time latency, std::uint32_t unknown_mask,
                    std::vector<Stream*> operands, std::size_t unknown)
        : Stream(workspace, latency, unknown_mask | std::uint32_t{1} << unknown,
                 std::move(operands)),
          unknown_(unknown) {}

    std::size_t unknown() const { return unknown_; }
    // When a value has settled, it replaces the unknown in all settled values of the machine; only
    // then is it appended.
    bool has_settled() const { return last_ >= 0; }
    const double* value() const { return value_.data(); }
    void append() {
        for (std::size_t c = 0; c < corners(); ++c) Stream::append(c, value_[c]);
    }

protected:
    const std::size_t unknown_;
    std::array<double, kMaxCorners> value_{};
};

// At every time, the fold over all offsets from 0 on. Where a trace was cut it speaks of recorded
// times alone, and is what the open reading says after them.
template <class F>
class UnboundedFutureStream final : public UnsettledStream {
public:
    using Element = typename F::Element;

    UnboundedFutureStream(Workspace& workspace, Operands<F> in, std::size_t unknown)
        : UnsettledStream(workspace, in.latency(), in.unknown_mask(), in.streams(), unknown),
          in_(in) {
        for (World w : {kLower, kUpper, kOpenLower, kOpenUpper}) {
            skips_[w] = in.skips(w, kNever, {});
            const Outlook& own = in.last().outlook(w);
            outlook_[w] = {in.absorbs(w) ? -latency_ : in.reach(w), in.floor(w), in.certain(w),
                           in.tail_of_tails(w)};
            if (skips_[w])
                outlook_[w] = {std::max<Time>(0, own.reach), own.floor, own.certain, own.tail};
        }
        for (World w : kCut) {
            const Outlook& open = outlook_[open_of(w)];
            goes_over_ |= !open.certain || open.reach > 0 || open.floor >= 0;
            outlook_[w] = {std::max<Time>(0, open.reach), open.floor, open.certain, open.tail};
        }
    }

    void prepare() override { in_.retain(latency_, 0); }

    void settle(Time t, const double*) override {
        if (t < latency_) return;
        last_ = t - latency_;
        for (std::size_t c = 0; c < corners(); ++c) {
            const double u = c >> unknown_ & 1 ? kInfinity : -kInfinity;
            Element rest = F::identity;
            if constexpr (F::width == 1) {
                rest = u;
            } else {
                rest.q = u;
            }
            value_[c] = F::result(F::combine_alone(in_.settled(last_, c), rest));
        }
    }

    void reset() override {
        Stream::reset();
        for (std::size_t w = 0; w < kWorlds; ++w)
            workspace_.unknowns.values[w][unknown_] =
                recorded(World(w)) ? F::result(F::identity) : tail_[w];
    }

    void find_open(World w, Time t) override {
        const Element tail = recorded(w) ? F::identity : in_.tail(w);
        tail_[w] = F::result(F::combine_alone(tail, tail));
        if (skips_[w]) tail_[w] = in_.last().tail(w);
        if (is_cut(w)) tail_[w] = Stream::tail(open_of(w));
        const std::size_t count = open_count(w, t);
        double* out = open(w, count);
        Element x = tail;
        const Time last = recorded(w) ? std::min(t, end(w, t)) : end(w, t);
        if (last > last_) {
            const Elements in = in_.values(w, last_ + 1, last, &workspace_.scratch[0]);
            for (auto i = static_cast<std::size_t>(last - last_); i-- > 0;) {
                x = F::combine_alone(get<F>(in.p, in.q, i), x);
                out[i] = F::result(x);
            }
        }
        workspace_.unknowns.values[w][unknown_] = F::result(x);
        if (skips_[w]) write_from(out, t + 1, w, t, in_.last(), w);
        if (is_cut(w)) write_from(out, t + 1, w, t, *this, open_of(w));
    }

private:
    bool reads_ahead(World w, bool ahead) const override { return !is_cut(w) && ahead; }
    // Whether what has settled is followed by recorded times alone.
    bool recorded(World w) const { return w == kNow || is_cut(w) || skips_[w]; }

    Operands<F> in_;
    std::array<bool, kWorlds> skips_{};
};

}  // namespace rtamt::episode
