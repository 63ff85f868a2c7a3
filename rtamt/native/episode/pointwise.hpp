// The stream of `and` and `or`.
#pragma once

#include <memory>

#include "episode/responses.hpp"

namespace rtamt::episode {

// At every time, the least or the greatest of two operands.
template <class F>
class PointwiseStream final : public Stream {
public:
    PointwiseStream(Workspace& workspace, Stream& a, Stream& b)
        : Stream(workspace, std::max(a.latency(), b.latency()), a.unknown_mask() | b.unknown_mask(),
                 {&a, &b}),
          a_(a),
          b_(b) {
        for (World w : kAhead) {
            Outlook& o = outlook_[w];
            const Outlook& x = a.outlook(w);
            const Outlook& y = b.outlook(w);
            o = {std::max(x.reach, y.reach), std::max(x.floor, y.floor), x.certain && y.certain,
                 F::combine(x.tail, y.tail)};
            for (const Outlook& operand : {x, y}) {
                if (!operand.certain || operand.tail != -F::identity) continue;
                o.reach = std::min(o.reach, operand.reach);
                o.certain = true;
                o.tail = operand.tail;
            }
            o.reach = std::max(o.reach, -latency_);
        }
        Parts parts;
        if (latency_ > 0 && add_to(parts, kGreatest)) summary_ = summary_of<F>(parts);
    }

    void propagate_demands() override {
        Stream::propagate_demands();
        if (summary_ && summarised(kNow, !kGreatest)) summary_->demand();
        for (World w : kAll)
            for (Stream* s : {&a_, &b_})
                if (summarised(w, kGreatest) && s->may_be_open(w)) s->summarise(w, kGreatest);
    }
    void prepare() override {
        for (Stream* s : {&a_, &b_}) s->retain(latency_ - s->latency() + 1);
        bool used = false;
        for (World w : kAll) {
            used |= summarised(w, !kGreatest);
            spreads_ |= summarised(w, kGreatest);
        }
        if (!used) summary_ = nullptr;
        if (summary_) summary_->prepare();
    }
    void settle(Time t, const double*) override {
        if (summary_) summary_->take(t);
        if (spreads_) {
            for (Stream* s : {&a_, &b_})
                if (t >= s->latency())
                    settled_ = F::combine_alone(settled_, s->settled(t - s->latency(), 0));
        }
        if (t < latency_) return;
        last_ = t - latency_;
        for (std::size_t c = 0; c < corners(); ++c)
            append(c, F::combine(a_.settled(last_, c), b_.settled(last_, c)));
    }

    void find_open(World w, Time t) override {
        if (!outlook_[w].certain) tail_[w] = F::combine(a_.tail(w), b_.tail(w));
        const std::size_t count = open_count(w, t);
        double* out = open(w, count);
        if (count == 0) return;
        const double* x = a_.values(w, last_ + 1, end(w, t), workspace_.scratch[0]);
        const double* y = b_.values(w, last_ + 1, end(w, t), workspace_.scratch[1]);
        combine_results<F>({x, x}, Elements{y, y}, out, count);
    }

    bool summarises(World w, bool greatest) const override {
        if (greatest != kGreatest) return summary_ && summary_->covers(w);
        if (latency_ == 0 || unknown_mask() != 0 || at_end(w) || !outlook_[w].certain) return false;
        return (!a_.may_be_open(w) || a_.summarises(w, greatest)) &&
               (!b_.may_be_open(w) || b_.summarises(w, greatest));
    }
    // The least of the lesser ones is the least of all values of both operands.
    Extremes extremes(World w, Time t) const override {
        Extremes found;
        if (t < 0) return found;
        if (summary_ && summarised(w, !kGreatest)) found.add(summary_->value(w, t));
        if (!summarised(w, kGreatest)) return found;
        double all = settled_;
        for (const Stream* s : {&a_, &b_}) {
            if (!s->may_be_open(w)) continue;
            const Extremes open = s->extremes(w, t);
            all = F::combine_alone(all, kGreatest ? open.greatest : open.least);
        }
        (kGreatest ? found.greatest : found.least) = all;
        return found;
    }
    bool add_to(Parts& parts, bool greatest) override {
        if (latency_ == 0 || greatest != kGreatest) return Stream::add_to(parts, greatest);
        return a_.add_to(parts, greatest) && b_.add_to(parts, greatest);
    }

    void reset() override {
        Stream::reset();
        if (summary_) summary_->reset();
        settled_ = F::identity;
    }
    void fields(Snapshot& s, Time t) override {
        Stream::fields(s, t);
        if (summary_) summary_->fields(s, t);
        if (spreads_) s.numbers(&settled_, 1);
    }

private:
    static constexpr bool kGreatest = F::identity < 0;

    Stream& a_;
    Stream& b_;
    std::unique_ptr<Summary> summary_;
    // For the reader of a like fold, the fold of the settled values of both operands.
    bool spreads_ = false;
    double settled_ = F::identity;
};

}  // namespace rtamt::episode
