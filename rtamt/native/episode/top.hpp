// What is read at time 0 alone.
#pragma once

#include <optional>

#include "episode/streams.hpp"

namespace rtamt::episode {


class Top {
public:
    Top() = default;
    Top(const Top&) = delete;
    Top& operator=(const Top&) = delete;
    virtual ~Top() = default;

    double value(World w) const { return values_[w]; }

    // Says what will ever be needed of the streams.
    virtual void demand() {}
    // Says what sample t and those after it need; the first sample for which that is not so any
    // more.
    virtual Time demand(Time) { return kNever; }
    virtual void prepare() {}
    bool wants(World w) const { return wants_[w]; }
    // Whether anything can change after sample t.
    virtual bool open(Time) const { return false; }
    virtual std::uint32_t speaks_of() const { return 0; }

    // Takes in what sample t has settled, and finds the value in every world.
    virtual void advance(Time t, const double* terms) = 0;
    virtual void substitute(std::size_t, const double*) {}

    virtual void reset() {}
    virtual void save(Writer&) const {}
    virtual void load(Reader&) {}

protected:
    std::array<double, kWorlds> values_{};
    std::array<bool, kWorlds> wants_{};
};

// A constant, or a term: what it is at the first sample.
class TopTerm final : public Top {
public:
    TopTerm(std::size_t term, std::optional<double> constant) : term_(term), constant_(constant) {
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
    void save(Writer& out) const override { out.put(values_); }
    void load(Reader& in) override { values_ = in.get<decltype(values_)>(); }

private:
    std::size_t term_;
    std::optional<double> constant_;
};

template <class M>
class TopMap final : public Top {
public:
    TopMap(const Top& a, const Top& b) : a_(a), b_(b) {}

    void advance(Time, const double*) override {
        for (World w : kAll) values_[w] = M::combine(a_.value(w), b_.value(w));
    }

private:
    const Top& a_;
    const Top& b_;
};

// The fold over offsets lo to hi from time 0.
template <class M>
class TopFold final : public Top {
public:
    using Element = typename M::Element;

    TopFold(Desk& desk, Time lo, Time hi, Stream& p, Stream& q)
        : desk_(desk),
          in_(p, q),
          begin_(lo == -kNever ? 0 : std::max<Time>(0, lo)),
          end_(hi),
          total_(in_.speaks_of() == 0 ? 1 : std::size_t{1} << desk.unknowns.count) {
        for (World w : kAll) {
            absorbs_[w] = in_.absorbs(w);
            quiet_[w] = begin_ == 0 && end_ == kNever && !in_.opens(w);
        }
        if (begin_ == 0 && end_ == kNever && M::width == 1 && in_.only()->summarises())
            summary_ = in_.only();
        reset();
    }

    void demand() override {
        for (World w : kAll) {
            wants_[w] = !absorbs_[w] || end_ < kNever;
            if (wants_[w]) want(w);
        }
    }
    Time demand(Time t) override {
        // While the window reaches into a tail that alone decides, there is nothing to find.
        for (World w : kAll) {
            wants_[w] = !absorbs_[w] || end_ <= in_.end(w, t);
            if (!wants_[w]) values_[w] = in_.tail_of_tails(w);
        }
        if (t - in_.late() > end_) return kNever;
        in_.enliven();
        Time changes = end_ + in_.late() + 1;
        for (World w : kAll) {
            if (wants_[w]) {
                want(w);
            } else {
                changes = std::min(changes, end_ - in_.reach(w));
            }
        }
        return changes;
    }
    void prepare() override { in_.hold(in_.late(), 0); }
    bool open(Time t) const override {
        return in_.speaks_of() != 0 || t - in_.late() < end_;
    }
    std::uint32_t speaks_of() const override { return in_.speaks_of(); }

    void advance(Time t, const double*) override {
        const Time time = t - in_.late();
        if (time >= begin_ && time <= end_) {
            for (std::size_t c = 0; c < total_.size(); ++c)
                total_[c] = M::combine(total_[c], in_.settled(time, c));
        }
        for (World w : kAll)
            if (wants_[w]) values_[w] = M::result(find(w, t));
    }

    void substitute(std::size_t unknown, const double* value) override {
        if (!(in_.speaks_of() >> unknown & 1)) return;
        const std::size_t bit = std::size_t{1} << unknown;
        for (std::size_t c = 0; c < total_.size(); ++c) {
            if (c & bit) continue;
            const Element low = total_[c];
            const Element high = total_[c | bit];
            for (const std::size_t corner : {c, c | bit}) {
                const auto at = [&](int k) {
                    return greater(component<M>(low, k),
                                   lesser(component<M>(high, k), value[corner]));
                };
                total_[corner] = M::element(at(0), at(M::width - 1));
            }
        }
    }
    void reset() override { std::fill(total_.begin(), total_.end(), M::identity); }
    void save(Writer& out) const override { out.put(total_.data(), total_.size()); }
    void load(Reader& in) override { in.get(total_.data(), total_.size()); }

private:
    void want(World w) const {
        if (summary_ != nullptr) {
            summary_->summarise(w);
        } else {
            in_.want(w);
        }
    }

    Element total(World w) const {
        if (total_.size() == 1) return total_[0];
        const auto component_in_world = [&](int k) {
            std::array<double, kMaxCorners> corners{};
            for (std::size_t c = 0; c < total_.size(); ++c)
                corners[c] = component<M>(total_[c], k);
            return desk_.unknowns.in_world(w, corners.data());
        };
        return M::element(component_in_world(0), component_in_world(M::width - 1));
    }

    Element find(World w, Time t) const {
        Element x = total(w);
        if (quiet_[w]) return M::combine(x, in_.tail(w));
        const Time last = in_.end(w, t);
        if (summary_ != nullptr) {
            if constexpr (M::width == 1) {
                const Extremes open = summary_->extremes(w, t);
                x = M::combine(x, M::identity > 0 ? open.least : open.greatest);
            }
        } else {
            const Time begin = std::max(begin_, t - in_.late() + 1);
            const Time end = std::min(end_, last);
            if (begin <= end)
                x = fold<M>(x, in_.values(w, begin, end, &desk_.scratch[0]),
                            static_cast<std::size_t>(end - begin + 1));
        }
        return end_ > std::max(last, begin_ - 1) ? M::combine(x, in_.tail(w)) : x;
    }

    Desk& desk_;
    Operands<M> in_;
    Time begin_;
    Time end_;
    std::array<bool, kWorlds> absorbs_{};
    std::array<bool, kWorlds> quiet_{};  // whether what has settled is followed by the tail
    Stream* summary_ = nullptr;
    std::vector<Element> total_;  // at every corner
};

}  // namespace rtamt::episode
