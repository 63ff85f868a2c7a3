// Streams: registers of the episode machine that are read at all times. The terms are explained in
// rtamt/machines/episode/machine.py; the definitions are in rtamt/machines/episode/streams.py.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "core/arrays.hpp"
#include "core/snapshot.hpp"
#include "episode/polynomials.hpp"

namespace rtamt::episode {

using Time = std::int64_t;
constexpr Time kNever = kMaxSamples;  // no bound

// Where the open values of a stream in a world end, and what comes after: at sample t they end at
// time max(t + reach, floor), and all later values are the tail.
struct Outlook {
    Time reach = 0;
    Time floor = -1;
    bool certain = true;  // whether the tail never changes
    double tail = 0.0;
};

struct Extremes {
    double least = kInfinity;
    double greatest = -kInfinity;

    void add(double x) {
        least = alone::lesser(least, x);
        greatest = alone::greater(greatest, x);
    }
};

// What a window is to its operator: what has to hold before a witness of `until`; a part of an
// operator without end, which begins at an offset. See rtamt/program/instructions.py.
struct Role {
    bool guard = false;
    std::optional<Time> endless_from;
};

// What the streams of one machine share: the unknowns, and memory for intermediate results.
struct Workspace {
    Unknowns unknowns;
    std::array<Scratch, 10> scratch;
};

class Stream;

// A window with two ends over one operand, whose greatest or least value it is.
struct WindowOf {
    Stream* operand;
    Time lo;
    Time hi;
    bool greatest;
};

// The streams of which a stream is the greatest or the least at every time: some that settle at
// once, and one window that does not.
struct Parts {
    std::vector<Stream*> settled;
    Stream* late = nullptr;
};

// A register that is read at all times: after sample t its values up to time t - latency are
// settled, the next ones are open, and all after those are the tail. Open values and the tail are
// found in the worlds that a reader wants.
class Stream {
public:
    // Unknowns that the settled values depend on are given by a bit each.
    Stream(Workspace& workspace, Time latency, std::uint32_t unknown_mask,
           std::vector<Stream*> operands);
    Stream(const Stream&) = delete;
    Stream& operator=(const Stream&) = delete;
    virtual ~Stream() = default;

    Time latency() const { return latency_; }
    std::uint32_t unknown_mask() const { return unknown_mask_; }
    const Outlook& outlook(World w) const { return outlook_[w]; }
    // The last time of the open values after sample t.
    Time end(World w, Time t) const {
        return w == kNow ? t : std::max(t + outlook_[w].reach, outlook_[w].floor);
    }
    bool may_be_open(World w) const {
        return w == kNow ? latency_ > 0
                         : latency_ + outlook_[w].reach > 0 || outlook_[w].floor >= 0;
    }

    // What readers demand: to keep so many settled values; to settle values (active); to find the
    // open values in a world up to the last sample (wanted), those after it and the tail too
    // (wanted ahead), or their least or greatest alone (summarised).
    void retain(Time count) {
        retained_ = std::max(retained_, static_cast<std::size_t>(std::max<Time>(1, count)));
    }
    void activate() { active_ = true; }
    void want(World w, bool ahead = true) {
        active_ = wanted_[w] = true;
        ahead_[w] |= ahead;
        if (is_cut(w) && goes_over_) want(open_of(w), ahead);
    }
    void summarise(World w, bool greatest) { active_ = summarised_[w][greatest] = true; }
    void clear_demands() {
        active_ = false;
        wanted_ = ahead_ = {};
        summarised_ = {};
    }
    bool active() const { return active_; }
    bool wanted(World w) const { return wanted_[w]; }
    bool summarised(World w, bool greatest) const { return summarised_[w][greatest]; }
    bool summarised(World w) const { return summarised(w, false) || summarised(w, true); }
    // Whether find_open has anything to find.
    bool finds_open(World w) const {
        if (!ahead_[w]) return wanted_[w] && latency_ > 0;
        return may_be_open(w) || !outlook_[w].certain;
    }
    // Demands of the operands what this stream needs of them.
    virtual void propagate_demands();
    // Called once, when all demands that readers will ever have are known.
    virtual void prepare() {}

    // Whether the least or the greatest of extremes() is found without find_open(), for a reader
    // who folds all settled values. The extremes may include some settled values.
    virtual bool summarises(World, bool /*greatest*/) const { return false; }
    virtual Extremes extremes(World, Time) const { return {}; }

    virtual std::optional<WindowOf> window() const { return {}; }
    // If it is summarised in kNow, the folds of the settled elements of its open windows.
    virtual std::span<const double> folded() const { return {}; }
    // Adds this stream to the parts of which another one is the greatest or the least. Returns
    // whether they are as Parts says.
    virtual bool add_to(Parts& parts, bool greatest);

    // Appends the value that sample t settles, if there is one.
    virtual void settle(Time t, const double* terms) = 0;
    // Finds the open values and the tail after sample t.
    virtual void find_open(World, Time) {}
    virtual void substitute(std::size_t unknown, const double* value) {
        history_.substitute(unknown, value);
    }

    double settled(Time time, std::size_t corner) const {
        const Line& line = history_.line(history_.corners() == 1 ? 0 : corner);
        return line[line.size() - 1 - static_cast<std::size_t>(last_ - time)];
    }
    double tail(World w) const { return tail_[w]; }
    // The values of times begin to end; in kNow they must exist.
    const double* values(World w, Time begin, Time end, Scratch& scratch) const;

    virtual void reset();
    // The fields after sample t.
    virtual void fields(Snapshot& s, Time t);

protected:
    // Whether the open values of a world, if they are wanted ahead or not, need operands ahead.
    virtual bool reads_ahead(World, bool ahead) const { return ahead; }

    std::size_t corners() const { return history_.corners(); }
    void append(std::size_t corner, double value);
    std::size_t open_count(World w, Time t) const {
        return static_cast<std::size_t>(std::max<Time>(0, end(w, t) - last_));
    }
    // Makes room for the open values of a world.
    double* open(World w, std::size_t count);
    // Writes the values of times `from` on, up to the last open one, as a stream has them in a
    // world; `out` is the place of the first open value.
    void write_from(double* out, Time from, World w, Time t, const Stream& stream, World its) {
        from = std::max(from, last_ + 1);
        const Time to = end(w, t);
        if (from > to) return;
        const double* values = stream.values(its, from, to, workspace_.scratch[0]);
        std::copy_n(values, to - from + 1, out + (from - last_ - 1));
    }

    struct Span {
        const double* data = nullptr;
        std::size_t size = 0;
    };

    Workspace& workspace_;
    Time latency_;
    Time last_ = -1;  // the time of the last settled value
    std::array<Outlook, kWorlds> outlook_;
    std::array<double, kWorlds> tail_{};
    std::array<Span, kWorlds> open_;
    // Whether from some time on the cut reading has the values of the open reading.
    bool goes_over_ = false;

private:
    std::uint32_t unknown_mask_;
    std::vector<Stream*> operands_;
    std::size_t retained_ = 1;
    Polynomials history_;
    bool active_ = false;
    std::array<bool, kWorlds> wanted_{};
    std::array<bool, kWorlds> ahead_{};
    std::array<std::array<bool, 2>, kWorlds> summarised_{};  // the least, the greatest
    std::array<std::vector<double>, kWorlds> memory_;
};

// A term that formulas read: settled at once, -inf or +inf at all unseen samples.
class Predicate final : public Stream {
public:
    Predicate(Workspace& workspace, std::size_t term) : Stream(workspace, 0, 0, {}), term_(term) {
        for (World w : kAhead) outlook_[w].tail = is_upper(w) ? kInfinity : -kInfinity;
    }
    void settle(Time t, const double* terms) override {
        append(0, terms[term_]);
        last_ = t;
    }

private:
    std::size_t term_;
};

class Constant final : public Stream {
public:
    Constant(Workspace& workspace, double value) : Stream(workspace, 0, 0, {}) {
        for (Outlook& outlook : outlook_) outlook.tail = value;
    }
    void settle(Time t, const double*) override {
        append(0, outlook_[kNow].tail);
        last_ = t;
    }
};

// The operands of a fold, read as its elements.
template <class F>
class Operands {
public:
    using Element = typename F::Element;

    // A fold of one operand has no second one.
    Operands(Stream& p, Stream& q) : p_(p), q_(F::width > 1 ? q : p) {}

    Time latency() const { return std::max(p_.latency(), q_.latency()); }
    std::uint32_t unknown_mask() const { return p_.unknown_mask() | q_.unknown_mask(); }
    // The operand of a fold of one.
    Stream* only() const { return &p_; }
    // The operand whose value the fold of one element is.
    const Stream& last() const { return q_; }
    // Whether a window up to offset hi skips unseen elements in a world, as they may not be there,
    // and whether that matters.
    bool skips(World w, Time hi, const Role& role) const {
        if (is_cut(w) || hi <= 0 || role.guard) return false;
        if (is_upper(w) != (component<F>(F::identity, F::width - 1) > 0)) return false;
        return !(neutral(w) && reach(w) <= 0 && floor(w) < 0);
    }
    std::vector<Stream*> streams() const { return {&p_, &q_}; }
    // Retains the values from offset `oldest` at time t - latency on.
    void retain(Time latency, Time oldest) const {
        for (Stream* s : {&p_, &q_}) s->retain(latency - s->latency() - oldest + 1);
    }

    // In kNow the tail is the identity, as there is nothing beyond the trace.
    Element tail(World w) const {
        return w == kNow ? F::identity : F::element(p_.tail(w), q_.tail(w));
    }
    bool certain(World w) const { return p_.outlook(w).certain && q_.outlook(w).certain; }
    bool may_be_open(World w) const {
        return w == kNow ? latency() > 0 : latency() + reach(w) > 0 || floor(w) >= 0;
    }
    Time floor(World w) const { return std::max(p_.outlook(w).floor, q_.outlook(w).floor); }
    Time reach(World w) const { return std::max(p_.outlook(w).reach, q_.outlook(w).reach); }
    Time end(World w, Time t) const { return std::max(p_.end(w, t), q_.end(w, t)); }
    // Whether the fold of anything and the tail is one value, which never changes. What holds at
    // all corners holds everywhere, as folds are lattice polynomials.
    bool absorbs(World w) const {
        return w != kNow && certain(w) &&
               at_corners(w, [&](double, double folded) { return same(folded, tail_of_tails(w)); });
    }
    // Whether the tail does not change the result of a fold.
    bool neutral(World w) const { return certain(w) && at_corners(w, same); }
    double tail_of_tails(World w) const {
        const Element x = tail_at_rest(w);
        return F::result(F::combine(x, x));
    }

    Element settled(Time time, std::size_t corner) const {
        return F::element(p_.settled(time, corner), q_.settled(time, corner));
    }
    // The elements of times begin to end; uses two scratches.
    Elements values(World w, Time begin, Time end, Scratch* scratch) const {
        const double* p = p_.values(w, begin, end, scratch[0]);
        return {p, &p_ == &q_ ? p : q_.values(w, begin, end, scratch[1])};
    }

private:
    template <class Holds>
    bool at_corners(World w, Holds holds) const {
        for (double p : {-kInfinity, kInfinity}) {
            for (double q : {-kInfinity, kInfinity}) {
                const Element x = F::element(p, q);
                if (!holds(F::result(x), F::result(F::combine(x, tail_at_rest(w))))) return false;
            }
        }
        return true;
    }
    Element tail_at_rest(World w) const {
        return F::element(p_.outlook(w).tail, q_.outlook(w).tail);
    }

    Stream& p_;
    Stream& q_;
};

}  // namespace rtamt::episode
