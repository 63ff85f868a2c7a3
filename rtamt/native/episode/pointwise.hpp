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
        if (summary_ && summarised(kNow)) summary_->demand();
    }
    void prepare() override {
        for (Stream* s : {&a_, &b_}) s->retain(latency_ - s->latency() + 1);
        bool used = false;
        for (World w : kAll) used |= summarised(w);
        if (!used) summary_ = nullptr;
        if (summary_) summary_->prepare();
    }
    void settle(Time t, const double*) override {
        if (summary_) summary_->take(t);
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
        return summary_ && greatest != kGreatest && summary_->covers(w);
    }
    Extremes extremes(World w, Time t) const override {
        Extremes found;
        if (t >= 0) found.add(summary_->value(w, t));
        return found;
    }
    bool add_to(Parts& parts, bool greatest) override {
        if (latency_ == 0 || greatest != kGreatest) return Stream::add_to(parts, greatest);
        return a_.add_to(parts, greatest) && b_.add_to(parts, greatest);
    }

    void reset() override {
        Stream::reset();
        if (summary_) summary_->reset();
    }
    void fields(Snapshot& s, Time t) override {
        Stream::fields(s, t);
        if (summary_) summary_->fields(s, t);
    }

private:
    static constexpr bool kGreatest = F::identity < 0;

    Stream& a_;
    Stream& b_;
    std::unique_ptr<Summary> summary_;
};

}  // namespace rtamt::episode
