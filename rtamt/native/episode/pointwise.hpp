// The stream of `and` and `or`.
#pragma once

#include "episode/streams.hpp"

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
    }

    void prepare() override {
        for (Stream* s : {&a_, &b_}) s->retain(latency_ - s->latency() + 1);
    }
    void settle(Time t, const double*) override {
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

private:
    Stream& a_;
    Stream& b_;
};

}  // namespace rtamt::episode
