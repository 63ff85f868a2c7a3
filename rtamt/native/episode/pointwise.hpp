// The stream of `and` and `or`, and of responses in it.
#pragma once

#include <algorithm>
#include <memory>
#include <optional>
#include <span>
#include <type_traits>
#include <vector>

#include "core/windows.hpp"
#include "episode/streams.hpp"

namespace rtamt::episode {

// Responses: `p or eventually[a:b] q` at every time, of which a reader wants the least of the open
// values; `p or always[a:b] q`; and their duals. The words here are for `or`.

// The extreme open value of a stream whose parts are known, kept from sample to sample.
class Summary {
public:
    explicit Summary(const Parts& parts) : parts_(parts), window_(*parts.late->window()) {}
    Summary(const Summary&) = delete;
    Summary& operator=(const Summary&) = delete;
    virtual ~Summary() = default;

    // Whether it holds in a world.
    virtual bool covers(World) const = 0;
    virtual void demand() {}
    virtual void prepare() {
        for (Stream* s : parts_.settled) s->retain(window_.hi + 1);
    }
    virtual void take(Time t) = 0;
    // The extreme of the open values, and of some settled ones.
    virtual double value(World w, Time t) = 0;
    virtual void reset() = 0;
    virtual void fields(Snapshot& s, Time t) = 0;

protected:
    // The greatest of the parts that settle at once.
    template <class F>
    double part(Time time) const {
        double x = F::identity;
        for (const Stream* s : parts_.settled) x = F::combine_alone(x, s->settled(time, 0));
        return x;
    }

    // Whether the unseen values of a stream do not matter to a fold.
    template <class F>
    static bool neutral(const Stream& q, World w) {
        const Outlook& o = q.outlook(w);
        return !at_end(w) && o.certain && same(o.tail, F::identity) && !q.may_be_open(w);
    }

    Parts parts_;
    WindowOf window_;
};

template <class F>
using Opposite = std::conditional_t<std::is_same_v<F, Min>, Max, Min>;

// The least of max(p, q[a:b]) over the windows that reach to the present, where F is Max. The later
// a window begins, the less is its q. So of two windows the earlier one does not matter if its p is
// not below the later one's, and p rises along the others. In the first of these the greatest
// q so far is not below p: there no window matters but the last, and its value is that q. In the
// rest q is below p, and the first has the least value. A sample moves windows from the rest to the
// first, or shortens the rest from its end.
template <class F>
class Response final : public Summary {
public:
    using Summary::Summary;

    static bool fits(const WindowOf& window) {
        return window.lo >= 0 && window.greatest == kGreatest && rises(*window.operand);
    }
    // A window that does not end with the trace takes in the best of unseen values.
    bool covers(World w) const override {
        return w == kNow || (late_ > 0 && neutral<Least>(*window_.operand->window()->operand, w));
    }
    void demand() override {
        if (late_ == 0) return;
        window_.operand->want(kNow);
        parts_.late->summarise(kNow, kGreatest);
    }
    void prepare() override {
        Summary::prepare();
        window_.operand->retain(std::max<Time>(1, window_.hi - late_ + 1));
    }
    void take(Time t) override {
        const double p = part<F>(t);
        const Time oldest = t - window_.hi;
        if (begin_ < rest_.size() && rest_[begin_].time < oldest) ++begin_;
        if (answered_ < oldest) value_ = Least::identity;
        if (begin_ < rest_.size() && reaches(p, rest_.back().p)) {
            const auto below = [p](const Waiting& w) { return !reaches(p, w.p); };
            rest_.erase(std::partition_point(first(), rest_.end(), below), rest_.end());
        }
        push({t, p});

        const Time settled = t - late_;
        const Time newest = settled - window_.lo;
        if (rest_[begin_].time > newest && answered_ < oldest) return;
        const double q = window_.operand->settled(settled, 0);
        const auto answered = [=](const Waiting& w) { return w.time <= newest && reaches(w.p, q); };
        if (answered(rest_[begin_])) {
            const auto end = std::partition_point(first(), rest_.end(), answered);
            answered_ = (end - 1)->time;
            value_ = q;
            begin_ = static_cast<std::size_t>(end - rest_.begin());
        } else if (answered_ >= oldest) {
            value_ = F::combine_alone(value_, q);
        }
    }
    double value(World w, Time t) override {
        if (late_ == 0) return least();
        if (w == kNow) ending_ = of_ending(t);
        return w == kNow ? Least::combine_alone(with_open(t), ending_) : ending_;
    }
    void reset() override {
        rest_.clear();
        begin_ = 0;
        answered_ = -kNever;
        value_ = Least::identity;
    }
    // The operands keep all values that matter.
    void fields(Snapshot& s, Time t) override {
        if (!s.reads()) return;
        reset();
        for (Time time = std::max<Time>(0, t - window_.hi); time <= t; ++time) take(time);
    }

private:
    using Least = Opposite<F>;
    static constexpr bool kGreatest = std::is_same_v<F, Max>;

    struct Waiting {
        Time time;
        double p;
    };

    // Whether the open values of a stream rise, so that the last one is the greatest.
    static bool rises(const Stream& q) {
        if (q.latency() == 0) return true;
        const std::optional<WindowOf> inner = q.window();
        return inner && inner->greatest != kGreatest && inner->operand->latency() == 0;
    }

    // The least value of the windows that reach to the present, and of settled values of q.
    double least() const {
        return begin_ == rest_.size() ? value_ : Least::combine_alone(value_, rest_[begin_].p);
    }
    // The same with the open values of q, of which these windows take in the last.
    double with_open(Time t) {
        const double q = *window_.operand->values(kNow, t, t, scratch_[0]);
        if (window_.lo == 0) return F::combine_alone(least(), q);
        const auto begun = [=, this](const Waiting& w) { return w.time <= t - window_.lo; };
        const auto next = std::partition_point(first(), rest_.end(), begun);
        const double x = F::combine_alone(next == first() ? value_ : least(), q);
        return Least::combine_alone(x, next->p);  // the window of the last sample has not begun
    }
    // The least value of the windows that end at open values of q.
    double of_ending(Time t) {
        const Time begin = std::max<Time>(0, t - parts_.late->latency() + 1);
        const Time end = t - window_.hi;
        if (begin > end) return Least::identity;
        const auto n = static_cast<std::size_t>(end - begin + 1);
        const std::span<const double> folded = parts_.late->folded();
        const std::size_t m = std::min(n, folded.size());
        const double* q = window_.operand->values(kNow, begin + window_.hi, t, scratch_[0]);
        const double* p = at_once(begin, end);
        double x = fold_across<Least, F>(Least::identity, {folded.data(), q, p}, m);
        for (std::size_t i = m; i < n; ++i)
            x = Least::combine_alone(x, F::combine_alone(p[i], q[i]));
        return x;
    }
    // The greatest of the parts that settle at once, at the times begin to end.
    const double* at_once(Time begin, Time end) {
        const auto n = static_cast<std::size_t>(end - begin + 1);
        const double* p = parts_.settled[0]->values(kNow, begin, end, scratch_[1]);
        for (std::size_t k = 1; k < parts_.settled.size(); ++k) {
            const double* next = parts_.settled[k]->values(kNow, begin, end, scratch_[1]);
            double* values = scratch_[2].reserve(n);
            combine_results<F>({p, p}, Elements{next, next}, values, n);
            p = values;
        }
        return p;
    }

    // Whether x is at least p.
    static bool reaches(double p, double x) { return same(F::combine_alone(p, x), x); }

    auto first() { return rest_.begin() + static_cast<std::ptrdiff_t>(begin_); }

    // Moves to the front of the memory before it grows.
    void push(Waiting w) {
        if (rest_.size() == rest_.capacity() && begin_ > rest_.size() / 2) {
            rest_.erase(rest_.begin(), first());
            begin_ = 0;
        }
        rest_.push_back(w);
    }

    std::vector<Waiting> rest_;  // from begin_ on, the windows whose q is below p
    std::size_t begin_ = 0;
    Time answered_ = -kNever;  // the last window whose q is not below p, and its value
    double value_ = Least::identity;
    double ending_ = Least::identity;
    Time late_ = window_.operand->latency();
    std::array<Scratch, 3> scratch_;
};

// The least of max(p, always[a:b] q), where F is Max. It is the least of max(q, once[a:b] p), whose
// values settle at once.
template <class F>
class Duration final : public Summary {
public:
    using Least = Opposite<F>;

    explicit Duration(const Parts& parts) : Summary(parts) {
        const auto width = static_cast<std::size_t>(window_.hi - window_.lo + 1);
        if (width > 1) begun_.emplace(width);
    }

    static bool fits(const WindowOf& window) {
        return window.lo >= 0 && window.greatest == std::is_same_v<Least, Max> &&
               window.operand->latency() == 0;
    }
    bool covers(World w) const override { return w == kNow || neutral<Least>(*window_.operand, w); }
    void take(Time t) override {
        const double p = begin(t - window_.lo);
        const double q = window_.operand->settled(t, 0);
        least_ = Least::combine_alone(least_, F::combine_alone(p, q));
    }
    double value(World, Time) override { return least_; }
    void reset() override {
        if (begun_) begun_->reset();
        least_ = Least::identity;
    }
    void fields(Snapshot& s, Time t) override {
        if (s.reads()) {
            reset();
            for (Time time = std::max<Time>(0, t - window_.hi); time <= t - window_.lo; ++time)
                begin(time);
        }
        s.numbers(&least_, 1);
    }

private:
    // Lets the window of a time begin; the least p of those that are begun and not over.
    double begin(Time time) {
        const double p = time < 0 ? Least::identity : part<F>(time);
        return begun_ ? begun_->push(p) : p;
    }

    std::optional<SlidingWindow<Least>> begun_;
    double least_ = Least::identity;
};

// Of parts of which one is late.
template <class F>
std::unique_ptr<Summary> summary_of(const Parts& parts) {
    if (Response<F>::fits(*parts.late->window())) return std::make_unique<Response<F>>(parts);
    if (Duration<F>::fits(*parts.late->window())) return std::make_unique<Duration<F>>(parts);
    return nullptr;
}

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
