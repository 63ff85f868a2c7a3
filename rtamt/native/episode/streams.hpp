// Registers of the episode machine as signals over all times: rtamt/episode.py has the words,
// rtamt/streams.py says what each means.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/arrays.hpp"
#include "core/line.hpp"

namespace rtamt::episode {

using Time = std::int64_t;

enum World : int { kNow, kLower, kUpper };
constexpr int kWorlds = 3;
constexpr World kAll[kWorlds] = {kNow, kLower, kUpper};

constexpr std::size_t kMaxUnknowns = 6;
constexpr std::size_t kMaxCorners = std::size_t{1} << kMaxUnknowns;

// Settled values are lattice polynomials in the unknowns, stored by their values at the corners:
// bit k of a corner says that unknown k is +inf there, else it is -inf.
struct Unknowns {
    std::size_t count = 0;
    std::array<std::array<double, kMaxUnknowns>, kWorlds> values{};

    // The value of a polynomial in a world; overwrites the corners.
    double in_world(World w, double* corners) const {
        std::size_t half = std::size_t{1} << count;
        for (std::size_t k = count; k-- > 0;) {
            half /= 2;
            const double u = values[w][k];
            for (std::size_t c = 0; c < half; ++c)
                corners[c] = greater(corners[c], lesser(corners[c + half], u));
        }
        return corners[0];
    }
};

// Lines of a polynomial each: `width` for every corner.
class Polynomials {
public:
    Polynomials() = default;
    Polynomials(std::size_t corners, std::size_t width)
        : corners_(corners), width_(width), lines_(corners * width) {}

    Line& line(std::size_t corner, std::size_t component = 0) {
        return lines_[component * corners_ + corner];
    }
    const Line& line(std::size_t corner, std::size_t component = 0) const {
        return lines_[component * corners_ + corner];
    }
    std::size_t size() const { return lines_[0].size(); }
    std::size_t corners() const { return corners_; }

    void pop() {
        for (Line& line : lines_) line.pop();
    }
    void clear() {
        for (Line& line : lines_) line.clear();
    }
    // Element i of a component in a world.
    double at(std::size_t i, std::size_t component, World w, const Unknowns& unknowns) const {
        if (corners_ == 1) return line(0, component)[i];
        std::array<double, kMaxCorners> corners{};
        for (std::size_t c = 0; c < corners_; ++c) corners[c] = line(c, component)[i];
        return unknowns.in_world(w, corners.data());
    }
    // Replaces an unknown by its value one sample later.
    void substitute(std::size_t unknown, const double* value);

    void save(Writer& out) const {
        for (const Line& line : lines_) line.save(out);
    }
    void load(Reader& in, std::size_t size) {
        for (Line& line : lines_) line.load(in, size);
    }

private:
    std::size_t corners_ = 0;
    std::size_t width_ = 0;
    std::vector<Line> lines_;
};

// What is known of a stream's open values in a world before there are any: after sample t, from
// time max(t + reach, floor) + 1 on they are the tail.
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
        least = lesser(least, x);
        greatest = greater(greatest, x);
    }
};

// Memory that the streams of one machine share while they look.
struct Desk {
    Unknowns unknowns;
    std::array<Scratch, 10> scratch;
};

// A register that is read at all times. In every world that a reader wants, it knows its values
// from the first time that is not settled on.
class Stream {
public:
    Stream(Desk& desk, Time late, std::uint32_t speaks_of);
    Stream(const Stream&) = delete;
    Stream& operator=(const Stream&) = delete;
    virtual ~Stream() = default;

    Time late() const { return late_; }
    std::uint32_t speaks_of() const { return speaks_of_; }  // unknowns, a bit each
    const Outlook& outlook(World w) const { return outlook_[w]; }
    Time end(World w, Time t) const {
        return w == kNow ? t : std::max(t + outlook_[w].reach, outlook_[w].floor);
    }

    // Whether there may be open values in a world.
    bool opens(World w) const {
        return w == kNow ? late_ > 0 : late_ + outlook_[w].reach > 0 || outlook_[w].floor >= 0;
    }

    // What readers need: so many settled values, and the open ones of a world.
    void hold(Time count) { keep_ = std::max(keep_, static_cast<std::size_t>(count)); }
    void want(World w) { alive_ = wanted_[w] = true; }
    void enliven() { alive_ = true; }
    void neglect() {
        alive_ = false;
        wanted_ = summarised_ = {};
    }
    bool alive() const { return alive_; }
    bool wanted(World w) const { return wanted_[w]; }
    bool summarised(World w) const { return summarised_[w]; }
    // Whether there is anything to find in a world, and so whether the operands are needed.
    bool looks(World w) const { return wanted_[w] && (opens(w) || !outlook_[w].certain); }
    // Says the same of what it reads itself.
    virtual void demand() {}
    // Called once, when it is known what will ever be wanted.
    virtual void prepare() {}

    // Whether it can tell the extremes of its open values without finding these, for a reader who
    // has all values that were ever settled. They may be those of some settled values as well.
    virtual bool summarises() const { return false; }
    void summarise(World w) { alive_ = summarised_[w] = true; }
    virtual Extremes extremes(World, Time) const { return {}; }

    // Takes in what sample t has settled.
    virtual void settle(Time t, const double* terms) = 0;
    // Finds the open values and the tail after sample t.
    virtual void look(World, Time) {}
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
    virtual void save(Writer& out) const;
    virtual void load(Reader& in, Time t);

protected:
    std::size_t corners() const { return history_.corners(); }
    void append(std::size_t corner, double value);
    double* open(World w, std::size_t count);

    struct View {
        const double* data = nullptr;
        std::size_t size = 0;
    };

    Desk& desk_;
    Time late_;
    Time last_ = -1;  // the time of the last settled value
    std::array<Outlook, kWorlds> outlook_;
    std::array<double, kWorlds> tail_{};
    std::array<View, kWorlds> open_;

private:
    std::uint32_t speaks_of_;
    std::size_t keep_ = 1;
    Polynomials history_;
    bool alive_ = false;
    std::array<bool, kWorlds> wanted_{};
    std::array<bool, kWorlds> summarised_{};
    std::array<std::vector<double>, kWorlds> memory_;
};

// A term read as a formula: settled at once, unknown at every unseen sample.
class Predicate final : public Stream {
public:
    Predicate(Desk& desk, std::size_t term) : Stream(desk, 0, 0), term_(term) {
        outlook_[kLower].tail = -kInfinity;
        outlook_[kUpper].tail = kInfinity;
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
    Constant(Desk& desk, double value) : Stream(desk, 0, 0) {
        for (Outlook& outlook : outlook_) outlook.tail = value;
    }
    void settle(Time t, const double*) override {
        append(0, outlook_[kNow].tail);
        last_ = t;
    }
};

// Operands of a fold, read as elements of its monoid.
template <class M>
class Operands {
public:
    using Element = typename M::Element;

    Operands(Stream& p, Stream& q) : p_(p), q_(q) {}

    Time late() const { return std::max(p_.late(), q_.late()); }
    std::uint32_t speaks_of() const { return p_.speaks_of() | q_.speaks_of(); }
    // The operand, where there is but one.
    Stream* only() const { return &p_ == &q_ ? &p_ : nullptr; }
    // Have the operands keep what a reader needs who reads offset `oldest` at t - late.
    void hold(Time late, Time oldest) const {
        for (Stream* s : {&p_, &q_}) s->hold(late - s->late() - oldest + 1);
    }
    void enliven() const {
        p_.enliven();
        q_.enliven();
    }
    void want(World w) const {
        p_.want(w);
        q_.want(w);
    }

    // Of kNow there is no tail: beyond the trace stands the identity.
    Element tail(World w) const {
        return w == kNow ? M::identity : M::element(p_.tail(w), q_.tail(w));
    }
    bool certain(World w) const {
        return p_.outlook(w).certain && q_.outlook(w).certain;
    }
    // Whether there may be open elements in a world.
    bool opens(World w) const {
        return w == kNow ? late() > 0 : late() + reach(w) > 0 || floor(w) >= 0;
    }
    Time floor(World w) const { return std::max(p_.outlook(w).floor, q_.outlook(w).floor); }
    Time reach(World w) const { return std::max(p_.outlook(w).reach, q_.outlook(w).reach); }
    Time end(World w, Time t) const { return std::max(p_.end(w, t), q_.end(w, t)); }
    // Folds are lattice polynomials: what holds at the corners, holds everywhere.
    // Whether the fold of anything and the tail is one value, known for ever.
    bool absorbs(World w) const {
        return w != kNow && certain(w) && at_corners([this, w](double, double folded) {
            return folded == tail_of_tails(w);
        }, w);
    }
    // Whether the fold of anything and the tail has the result of the former.
    bool neutral(World w) const {
        return certain(w) &&
               at_corners([](double q, double folded) { return folded == q; }, w);
    }
    double tail_of_tails(World w) const {
        const Element x = tail_at_rest(w);
        return M::result(M::combine(x, x));
    }

    Element settled(Time time, std::size_t corner) const {
        return M::element(p_.settled(time, corner), q_.settled(time, corner));
    }
    // The elements of times begin to end; two scratches are used.
    Elements values(World w, Time begin, Time end, Scratch* scratch) const {
        const double* p = p_.values(w, begin, end, scratch[0]);
        return {p, &p_ == &q_ ? p : q_.values(w, begin, end, scratch[1])};
    }

private:
    template <class Holds>
    bool at_corners(Holds holds, World w) const {
        for (double p : {-kInfinity, kInfinity}) {
            for (double q : {-kInfinity, kInfinity}) {
                const Element x = M::element(p, q);
                if (!holds(M::result(x), M::result(M::combine(x, tail_at_rest(w))))) return false;
            }
        }
        return true;
    }
    Element tail_at_rest(World w) const {
        return M::element(p_.outlook(w).tail, q_.outlook(w).tail);
    }

    Stream& p_;
    Stream& q_;
};

}  // namespace rtamt::episode
