// Registers of the episode machine that are read at time 0 alone; the last is the robustness.
#pragma once

#include <optional>

#include "episode/streams.hpp"

namespace rtamt::episode {

class InitialValue {
public:
    InitialValue() = default;
    InitialValue(const InitialValue&) = delete;
    InitialValue& operator=(const InitialValue&) = delete;
    virtual ~InitialValue() = default;

    double value(World w) const { return values_[w]; }

    // Demands of the streams all that will ever be needed.
    virtual void demand() {}
    // Demands what sample t and later ones need. Returns the first sample that needs less.
    virtual Time demand(Time) { return kNever; }
    virtual void prepare() {}
    bool wants(World w) const { return wants_[w]; }
    // Whether the value can change after sample t.
    virtual bool open(Time) const { return false; }
    virtual std::uint32_t unknown_mask() const { return 0; }

    // Finds the value after sample t in every world.
    virtual void advance(Time t, const double* terms) = 0;
    // Finds the value of a trace that was cut after sample t, whose streams have found theirs.
    virtual void cut(Time) {}
    virtual void substitute(std::size_t, const double*) {}

    virtual void reset() {}
    virtual void fields(Snapshot&) {}

protected:
    std::array<double, kWorlds> values_{};
    std::array<bool, kWorlds> wants_{};
};

// A constant, or the value of a term at the first sample.
class InitialTerm final : public InitialValue {
public:
    InitialTerm(std::size_t term, std::optional<double> constant)
        : term_(term), constant_(constant) {
        reset();
    }

    Time demand(Time t) override { return t <= 0 ? 1 : kNever; }
    bool open(Time t) const override { return t < 0; }
    void advance(Time t, const double* terms) override {
        if (t == 0) values_.fill(terms[term_]);
    }
    void reset() override {
        values_ = {0.0, -kInfinity, kInfinity};
        if (constant_) values_.fill(*constant_);
    }
    void fields(Snapshot& s) override { s(values_); }

private:
    std::size_t term_;
    std::optional<double> constant_;
};

template <class F>
class InitialMap final : public InitialValue {
public:
    InitialMap(const InitialValue& a, const InitialValue& b) : a_(a), b_(b) {}

    void advance(Time, const double*) override {
        for (World w : kAll) find(w);
    }
    void cut(Time) override {
        for (World w : kCut) find(w);
    }

private:
    void find(World w) { values_[w] = F::combine_alone(a_.value(w), b_.value(w)); }

    const InitialValue& a_;
    const InitialValue& b_;
};

// The fold over the times lo to hi.
template <class F>
class InitialFold final : public InitialValue {
public:
    using Element = typename F::Element;

    InitialFold(Workspace& workspace, Operands<F> in, Time lo, Time hi, const Role& role)
        : workspace_(workspace),
          in_(in),
          begin_(std::max<Time>(0, lo)),
          end_(hi),
          endless_from_(role.endless_from),
          total_(workspace.unknowns.corners(in.unknown_mask())) {
        for (World w : kAhead) skips_[w] = in_.skips(w, hi, role);
        for (World w : kAll) absorbs_[w] = !skips_[w] && in_.absorbs(w);
        if (begin_ == 0 && end_ == kNever) {
            for (World w : kAll) quiet_[w] = !in_.may_be_open(w);
            for (World w : kAhead)
                if (recorded(w)) quiet_[w] = in_.latency() == 0;
        }
        if constexpr (F::width == 1) {
            if (begin_ > 0 || end_ < kNever) return;
            for (std::size_t w = 0; w < kWorlds; ++w)
                summarised_[w] = in_.only()->summarises(World(w), F::identity < 0);
        }
    }

    void demand() override {
        for (World w : kAll) {
            wants_[w] = !absorbs_[w] || end_ < kNever;
            if (wants_[w]) want(w);
        }
        want_cut();
    }
    Time demand(Time t) override {
        // While the window reaches into a tail that absorbs all else, there is nothing to find.
        for (World w : kAll) {
            wants_[w] = !absorbs_[w] || end_ <= in_.end(w, t);
            if (!wants_[w]) values_[w] = in_.tail_of_tails(w);
        }
        if (t - in_.latency() > end_) return kNever;
        for (Stream* stream : in_.streams()) stream->activate();
        want_cut();
        Time changes = end_ + in_.latency() + 1;
        for (World w : kAll) {
            if (wants_[w]) {
                want(w);
            } else {
                changes = std::min(changes, end_ - in_.reach(w));
            }
        }
        return changes;
    }
    void prepare() override { in_.retain(in_.latency(), 0); }
    bool open(Time t) const override { return in_.unknown_mask() != 0 || t - in_.latency() < end_; }
    std::uint32_t unknown_mask() const override { return in_.unknown_mask(); }

    void advance(Time t, const double*) override {
        const Time time = t - in_.latency();
        if (time >= begin_ && time <= end_) {
            for (std::size_t c = 0; c < total_.corners(); ++c) total_.add(c, in_.settled(time, c));
        }
        for (World w : kAll)
            if (wants_[w]) values_[w] = F::result(find(w, t));
    }

    void cut(Time t) override {
        for (World w : kCut) {
            const bool over = endless_from_ && *endless_from_ > t;
            values_[w] = F::result(find(over ? open_of(w) : w, t));
        }
    }

    void substitute(std::size_t unknown, const double* value) override {
        if (in_.unknown_mask() >> unknown & 1) total_.substitute(unknown, value);
    }
    void reset() override { total_.reset(); }
    void fields(Snapshot& s) override { total_.fields(s); }

private:
    void want(World w, bool ahead = true) const {
        if (summarised_[w]) {
            in_.only()->summarise(w, component<F>(F::identity, 0) < 0);
        } else {
            for (Stream* stream : in_.streams()) stream->want(w, ahead);
        }
    }
    void want_cut() {
        for (World w : kCut) {
            wants_[w] = true;
            want(w, !recorded(w));
            if (!endless_from_) continue;
            wants_[open_of(w)] = true;
            want(open_of(w));
        }
    }
    // Whether the fold is over recorded times alone.
    bool recorded(World w) const { return w == kNow || skips_[w] || (is_cut(w) && end_ == kNever); }

    Element find(World w, Time t) const {
        if (skips_[w] && t < 0) {  // time 0 is there
            if (begin_ > 0) return F::identity;
            const Elements in = in_.values(w, 0, 0, &workspace_.scratch[0]);
            return get<F>(in.p, in.q, 0);
        }
        Element x = total_.in_world(w, workspace_.unknowns);
        const Element tail = recorded(w) ? F::identity : in_.tail(w);
        if (quiet_[w]) return F::combine_alone(x, tail);
        const Time last = recorded(w) ? t : in_.end(w, t);
        if (summarised_[w]) {
            if constexpr (F::width == 1) {
                const Extremes open = in_.only()->extremes(w, t);
                x = F::combine_alone(x, F::identity > 0 ? open.least : open.greatest);
                // The last values of recorded times may hold at all later ones.
                if (in_.end(w, t) < last) x = F::combine_alone(x, in_.tail(w));
            }
        } else {
            const Time begin = std::max(begin_, t - in_.latency() + 1);
            const Time end = std::min(end_, last);
            if (begin <= end)
                x = fold<F>(x, in_.values(w, begin, end, &workspace_.scratch[0]),
                            static_cast<std::size_t>(end - begin + 1));
        }
        return end_ > std::max(last, begin_ - 1) ? F::combine_alone(x, tail) : x;
    }

    Workspace& workspace_;
    Operands<F> in_;
    Time begin_;
    Time end_;
    std::optional<Time> endless_from_;
    std::array<bool, kWorlds> skips_{};
    std::array<bool, kWorlds> absorbs_{};
    std::array<bool, kWorlds> quiet_{};       // whether the tail follows what has settled
    std::array<bool, kWorlds> summarised_{};  // whether the operand finds its extremes
    SettledFold<F> total_;
};

}  // namespace rtamt::episode
