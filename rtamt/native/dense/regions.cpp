#include "dense/regions.hpp"

#include <cstdlib>
#include <limits>
#include <stdexcept>
#include <utility>

#include "dense/runs.hpp"

namespace rtamt::dense {

namespace {

constexpr Time kEver = std::numeric_limits<Time>::max();
constexpr std::size_t kWorlds = Regions::worlds;

bool is_cut(std::size_t world) { return world >= Regions::cut_lower; }

}  // namespace

// What all registers of a trace share: the values of the unknowns in each world.
struct RegionTrace {
    std::size_t axes = 0;
    std::size_t corners = 1;
    std::vector<std::array<double, kWorlds>> unknowns;
    mutable std::vector<double> scratch;

    std::size_t bit(std::size_t axis) const { return std::size_t{1} << (axes - 1 - axis); }

    // The number of a polynomial, given at its corners, in a world.
    template <class Get>
    double in_world(std::size_t world, Get corner) const {
        if (axes == 0) return corner(0);
        scratch.resize(corners);
        for (std::size_t c = 0; c < corners; ++c) scratch[c] = corner(c);
        std::size_t half = corners;
        for (std::size_t axis = 0; axis < axes; ++axis) {
            half /= 2;
            for (std::size_t c = 0; c < half; ++c)
                scratch[c] =
                    greater(scratch[c], lesser(scratch[half + c], unknowns[axis][world]));
        }
        return scratch[0];
    }
    Pair in_world(std::size_t world, const Pair* element) const {
        return {in_world(world, [=](std::size_t c) { return element[c].p; }),
                in_world(world, [=](std::size_t c) { return element[c].q; })};
    }
    // Writes an unknown of polynomials as a polynomial in what it is later.
    void substitute(std::vector<Pair>& values, std::size_t axis,
                    const std::vector<double>& value) const {
        const std::size_t mask = bit(axis);
        for (std::size_t at = 0; at < values.size(); at += corners) {
            for (std::size_t c = 0; c < corners; ++c) {
                if (c & mask) continue;
                const Pair low = values[at + c], high = values[at + (c | mask)];
                for (const std::size_t d : {c, c | mask})
                    values[at + d] = {greater(low.p, lesser(high.p, value[d])),
                                      greater(low.q, lesser(high.q, value[d]))};
            }
        }
    }
};

// A register that is read at all positions.
class RegionStream {
public:
    RegionStream(const RegionTrace& trace, Time late) : trace_(trace), late_(late) {
        kept_.corners = trace.corners;
    }
    RegionStream(const RegionStream&) = delete;
    RegionStream& operator=(const RegionStream&) = delete;
    virtual ~RegionStream() = default;

    Time late() const { return late_; }
    Time last() const { return last_; }
    void hold(Time positions) { keep_ = std::max(keep_, positions); }

    // Finds the runs that settle with position t; false if there are none.
    bool settle(Time t) {
        if (t - late_ <= last_) return false;
        new_ = settled_runs(last_ + 1, t - late_);
        return true;
    }
    const Runs& settling() const { return new_; }
    void keep(Time t) {
        kept_.append(new_);
        last_ = t - late_;
    }
    void trim() {
        const std::size_t first = kept_.place(last_ + 1 - keep_);
        if (first == 0) return;
        kept_.starts.erase(kept_.starts.begin(),
                           kept_.starts.begin() + static_cast<std::ptrdiff_t>(first));
        kept_.values.erase(
            kept_.values.begin(),
            kept_.values.begin() + static_cast<std::ptrdiff_t>(first * kept_.corners));
    }
    virtual void substitute(std::size_t axis, const std::vector<double>& value) {
        trace_.substitute(kept_.values, axis, value);
    }
    void look(std::size_t world, Time t, RegionTrace& trace) {
        open_[world] = open_runs(world, last_ + 1, t, trace);
    }

    Runs settled(Time begin, Time end) const { return clipped(kept_, begin, end); }
    // The runs of a world from a position on.
    Runs seen(std::size_t world, Time begin) const {
        if (begin > last_) return clipped(open_[world], begin);
        Runs found;
        for (std::size_t i = kept_.place(begin); i < kept_.size(); ++i) {
            const Pair value = trace_.in_world(world, kept_.at(i));
            found.push(std::max(begin, kept_.starts[i]), &value);
        }
        found.append(open_[world]);
        return found;
    }

    virtual void reset() {
        last_ = -1;
        kept_.starts.clear();
        kept_.values.clear();
    }
    virtual void fields(Snapshot& s) {
        s(last_);
        kept_.fields(s);
        if (kept_.empty()) {
            s.require(last_ < 0);
        } else {
            s.require(kept_.starts.front() <= std::max<Time>(0, last_ + 1 - keep_));
            s.require(kept_.starts.front() >= 0 && kept_.starts.back() <= last_);
        }
    }

protected:
    virtual Runs settled_runs(Time begin, Time end) = 0;
    virtual Runs open_runs(std::size_t world, Time begin, Time t, RegionTrace& trace) const = 0;

    Runs constant(double value, Time start, std::size_t corners = 1) const {
        Runs found;
        found.corners = corners;
        found.add(start, Pair{0.0, value});
        return found;
    }

    const RegionTrace& trace_;
    Runs kept_;
    std::array<Runs, kWorlds> open_;

private:
    Time late_;
    Time keep_ = 1;
    Time last_ = -1;
    Runs new_;
};

namespace {

// A term read as a formula.
class Predicate final : public RegionStream {
public:
    explicit Predicate(const RegionTrace& trace) : RegionStream(trace, 0) {}

    void take(const Time* positions, const double* values, std::size_t n) {
        next_ = Runs();
        next_.corners = trace_.corners;
        const Time begin = last() + 1;
        if (n == 0 || positions[0] > begin) next_.add(begin, kept_.at(kept_.size() - 1));
        for (std::size_t i = 0; i < n; ++i)
            if (next_.empty() || !same(next_.values.back().q, values[i]))
                next_.add(positions[i], Pair{0.0, values[i]});
    }

protected:
    Runs settled_runs(Time, Time) override { return std::move(next_); }
    Runs open_runs(std::size_t world, Time begin, Time, RegionTrace&) const override {
        const bool best = world == Regions::upper || world == Regions::cut_upper;
        return constant(best ? kInfinity : -kInfinity, begin);
    }

private:
    Runs next_;
};

class Constant final : public RegionStream {
public:
    Constant(const RegionTrace& trace, double value) : RegionStream(trace, 0), value_(value) {}

protected:
    Runs settled_runs(Time begin, Time) override {
        return constant(value_, begin, trace_.corners);
    }
    Runs open_runs(std::size_t, Time begin, Time, RegionTrace&) const override {
        return constant(value_, begin);
    }

private:
    double value_;
};

class Pointwise final : public RegionStream {
public:
    Pointwise(const RegionTrace& trace, RegionFold fold, RegionStream& a, RegionStream& b)
        : RegionStream(trace, std::max(a.late(), b.late())), fold_(fold), a_(a), b_(b) {
        for (RegionStream* s : {&a, &b}) s->hold(late() - s->late());
    }

protected:
    Runs settled_runs(Time begin, Time end) override {
        return across(joint(a_.settled(begin, end), b_.settled(begin, end), begin));
    }
    Runs open_runs(std::size_t world, Time begin, Time, RegionTrace&) const override {
        return across(joint(a_.seen(world, begin), b_.seen(world, begin), begin));
    }

private:
    Runs across(const Runs& pairs) const {
        Runs found;
        found.corners = pairs.corners;
        std::vector<Pair> elements(pairs.corners);
        for (std::size_t i = 0; i < pairs.size(); ++i) {
            for (std::size_t c = 0; c < pairs.corners; ++c)
                elements[c] = {0.0, fold_.upper(pairs.at(i)[c].p, pairs.at(i)[c].q)};
            found.push(pairs.starts[i], elements.data());
        }
        return found;
    }

    RegionFold fold_;
    RegionStream& a_;
    RegionStream& b_;
};

// The operands of a window, read as elements of its fold.
class Operands {
public:
    Operands(RegionFold fold, RegionStream& a, RegionStream& b) : fold(fold), a_(a), b_(b) {}

    Time late() const { return single() ? b_.late() : std::max(a_.late(), b_.late()); }
    Time last() const { return single() ? b_.last() : std::min(a_.last(), b_.last()); }
    void hold(Time late, Time oldest) {
        for (RegionStream* s : {&a_, &b_}) s->hold(late - s->late() - oldest);
    }
    Runs settled(Time begin, Time end, std::size_t corners) const {
        const Time first = std::max<Time>(0, begin);
        if (first > end) {
            Runs none;
            none.corners = corners;
            none.add(begin, fold.identity());
            return none;
        }
        if (single()) return b_.settled(first, end);
        return paired(fold, joint(a_.settled(first, end), b_.settled(first, end), first), end);
    }
    Runs seen(std::size_t world, Time begin) const {
        const Time first = std::max<Time>(0, begin);
        if (single()) return b_.seen(world, first);
        return paired(fold, joint(a_.seen(world, first), b_.seen(world, first), first), {});
    }

    const RegionFold fold;

private:
    bool single() const { return fold.kind == Kind::single; }

    RegionStream& a_;
    RegionStream& b_;
};

// How a window reads the end of a trace.
struct Reading {
    explicit Reading(const RegionRow& row, RegionFold fold)
        : ahead(!row.hi || *row.hi > 0),
          guard(row.guard),
          endless(row.endless || !row.hi),
          least(fold.least),
          begin(row.guard ? *row.hi + 1 : row.lo.value_or(0)) {}

    // Whether it reads nothing behind the last position but its own.
    bool stops(std::size_t world) const {
        if (world == Regions::now) return ahead;
        return ahead && !guard && world == (least ? Regions::upper : Regions::lower);
    }

    bool ahead;
    bool guard;
    bool endless;
    bool least;
    Time begin;
};

// What a fold that stops is at unseen positions: its own element, or nothing.
void append_own(Runs& found, RegionFold fold, Time lo, const Runs& elements, Time begin) {
    if (lo == 0) {
        found.append(clipped(elements, begin));
    } else {
        const Pair none{0.0, fold.empty()};
        found.push(begin, &none);
    }
}

class Sliding final : public RegionStream {
public:
    Sliding(const RegionTrace& trace, const RegionRow& row, RegionFold fold, RegionStream& a,
            RegionStream& b)
        : RegionStream(trace, std::max<Time>(0, Operands(fold, a, b).late() + *row.hi)),
          operands_(fold, a, b),
          reading_(row, fold),
          lo_(*row.lo),
          hi_(*row.hi) {
        operands_.hold(late(), lo_);
    }

protected:
    Runs settled_runs(Time begin, Time end) override {
        const Runs elements = operands_.settled(begin + lo_, end + hi_, trace_.corners);
        return slid(operands_.fold, elements, lo_, hi_, begin, end);
    }
    Runs open_runs(std::size_t world, Time begin, Time t, RegionTrace&) const override {
        const Runs elements = operands_.seen(world, begin + lo_);
        if (reading_.stops(world)) {
            Runs found;
            if (begin <= t) {
                Runs known = clipped(elements, begin + lo_, t);
                known.add(std::max(t + 1, begin + lo_), operands_.fold.identity());
                found = slid(operands_.fold, known, lo_, hi_, begin, t);
            }
            append_own(found, operands_.fold, lo_, elements, std::max(begin, t + 1));
            return found;
        }
        if (reading_.endless && is_cut(world)) {
            const Time recorded = t - reading_.begin;
            Runs found;
            if (begin <= recorded)
                found = slid(operands_.fold, elements, lo_, hi_, begin, recorded);
            found.append(clipped(open_[world - 2], std::max(begin, recorded + 1)));
            return found;
        }
        return slid(operands_.fold, elements, lo_, hi_, begin);
    }

private:
    Operands operands_;
    Reading reading_;
    Time lo_;
    Time hi_;
};

// The fold over all offsets up to hi.
class UnboundedPast final : public RegionStream {
public:
    UnboundedPast(const RegionTrace& trace, const RegionRow& row, RegionFold fold, RegionStream& a,
                  RegionStream& b)
        : RegionStream(trace, std::max<Time>(0, Operands(fold, a, b).late() + *row.hi)),
          operands_(fold, a, b),
          hi_(*row.hi) {
        operands_.hold(late(), hi_);
        UnboundedPast::reset();
    }

    void substitute(std::size_t axis, const std::vector<double>& value) override {
        RegionStream::substitute(axis, value);
        trace_.substitute(total_, axis, value);
    }
    void reset() override {
        RegionStream::reset();
        total_.assign(trace_.corners, operands_.fold.identity());
    }
    void fields(Snapshot& s) override {
        RegionStream::fields(s);
        s.numbers(total_.data(), total_.size());
    }

protected:
    Runs settled_runs(Time begin, Time end) override {
        return scanned(total_, operands_.settled(begin + hi_, end + hi_, trace_.corners), begin);
    }
    Runs open_runs(std::size_t world, Time begin, Time, RegionTrace&) const override {
        std::vector<Pair> total{trace_.in_world(world, total_.data())};
        return scanned(total, operands_.seen(world, begin + hi_), begin);
    }

private:
    Runs scanned(std::vector<Pair>& total, const Runs& elements, Time begin) const {
        Runs found;
        found.corners = elements.corners;
        if (elements.starts[0] - hi_ > begin) found.push(begin, total.data());
        for (std::size_t i = 0; i < elements.size(); ++i) {
            for (std::size_t c = 0; c < elements.corners; ++c)
                total[c] = operands_.fold.combine(total[c], elements.at(i)[c]);
            found.push(elements.starts[i] - hi_, total.data());
        }
        return found;
    }

    Operands operands_;
    Time hi_;
    std::vector<Pair> total_;
};

}  // namespace

// The fold over all offsets from 0 on, which settles as a polynomial in its unknown.
class RegionFuture final : public RegionStream {
public:
    RegionFuture(const RegionTrace& trace, const RegionRow& row, RegionFold fold, RegionStream& a,
                 RegionStream& b, std::size_t axis)
        : RegionStream(trace, Operands(fold, a, b).late()),
          operands_(fold, a, b),
          reading_(row, fold),
          axis_(axis) {
        operands_.hold(late(), 0);
    }

    std::size_t axis() const { return axis_; }

protected:
    Runs settled_runs(Time begin, Time end) override {
        std::vector<Pair> rest(trace_.corners, operands_.fold.identity());
        for (std::size_t c = 0; c < rest.size(); ++c)
            rest[c].q = c & trace_.bit(axis_) ? kInfinity : -kInfinity;
        return merged(suffixes(operands_.fold,
                               operands_.settled(begin, end, trace_.corners), rest));
    }
    Runs open_runs(std::size_t world, Time begin, Time t, RegionTrace& trace) const override {
        const Runs elements = operands_.seen(world, begin);
        const bool stops = reading_.stops(world);
        if (!stops && !is_cut(world)) t = elements.starts.back();
        Runs found;
        double unknown = operands_.fold.empty();  // nothing follows what has settled
        if (begin <= t) {
            found = merged(suffixes(operands_.fold, clipped(elements, begin, t),
                                    {operands_.fold.identity()}));
            unknown = found.at(0)->q;
        }
        trace.unknowns[axis_][world] = unknown;
        if (is_cut(world)) {
            found.append(clipped(open_[world - 2], std::max(begin, t + 1)));
        } else if (stops) {
            append_own(found, operands_.fold, 0, elements, std::max(begin, t + 1));
        }
        return found;
    }

private:
    static Runs merged(const Runs& runs) {
        Runs found;
        found.corners = runs.corners;
        found.append(runs);
        return found;
    }

    Operands operands_;
    Reading reading_;
    std::size_t axis_;
};

// The fold over positions lo to hi, which is read at position 0 alone.
class AtBegin {
public:
    AtBegin(const RegionTrace& trace, const RegionRow& row, RegionFold fold, RegionStream& a,
            RegionStream& b)
        : trace_(trace),
          operands_(fold, a, b),
          reading_(row, fold),
          lo_(std::max<Time>(0, row.lo.value_or(0))),
          hi_(row.hi) {
        operands_.hold(operands_.late(), 0);
        reset();
    }

    void substitute(std::size_t axis, const std::vector<double>& value) {
        trace_.substitute(total_, axis, value);
    }
    void settle() {
        Time end = operands_.last();
        const Time begin = std::max(lo_, last_ + 1);
        last_ = std::max(end, last_);
        if (hi_) end = std::min(end, *hi_);
        if (begin > end) return;
        const Runs elements = operands_.settled(begin, end, trace_.corners);
        for (std::size_t i = 0; i < elements.size(); ++i)
            for (std::size_t c = 0; c < total_.size(); ++c)
                total_[c] = operands_.fold.combine(total_[c], elements.at(i)[c]);
    }
    double value(std::size_t world, Time t) const {
        if (is_cut(world) && reading_.endless && reading_.begin > t) return value(world - 2, t);
        Pair total = trace_.in_world(world, total_.data());
        const Time begin = std::max(lo_, last_ + 1);
        Time end = hi_.value_or(kEver);
        if (is_cut(world) && !hi_) {
            end = t;
        } else if (reading_.stops(world)) {
            end = std::min(end, lo_ == 0 ? std::max<Time>(t, 0) : t);
        }
        if (begin > end) return total.q;
        const Runs elements = clipped(operands_.seen(world, begin), begin, end);
        for (std::size_t i = 0; i < elements.size(); ++i)
            total = operands_.fold.combine(total, *elements.at(i));
        return total.q;
    }

    void reset() {
        last_ = -1;
        total_.assign(trace_.corners, operands_.fold.identity());
    }
    void fields(Snapshot& s) {
        s(last_);
        s.require(last_ == operands_.last());
        s.numbers(total_.data(), total_.size());
    }

private:
    const RegionTrace& trace_;
    Operands operands_;
    Reading reading_;
    Time lo_;
    std::optional<Time> hi_;
    Time last_ = -1;
    std::vector<Pair> total_;
};

Regions::Regions(std::size_t terms, const std::vector<RegionConstant>& constants,
                 const std::vector<RegionRow>& rows, const std::vector<std::size_t>& initial,
                 const std::vector<std::size_t>& streams, const std::vector<std::size_t>& unknowns)
    : terms_(terms),
      constants_(terms),
      rows_(rows),
      initial_(initial),
      streams_(terms + rows.size()),
      order_(streams),
      folds_(terms + rows.size()),
      trace_(std::make_unique<RegionTrace>()) {
    const std::size_t registers = terms + rows.size();
    const auto require = [](bool condition) {
        if (!condition) throw std::invalid_argument("expected a program over regions");
    };
    constexpr std::size_t kMostUnknowns = 16;
    require(unknowns.size() <= kMostUnknowns && !initial.empty());
    for (const RegionConstant& c : constants) {
        require(c.reg < terms);
        constants_[c.reg] = c.value;
    }
    trace_->axes = unknowns.size();
    trace_->corners = std::size_t{1} << unknowns.size();
    trace_->unknowns.resize(unknowns.size());
    Fingerprint print;
    print.add(terms, initial.size(), streams.size(), unknowns.size());
    for (const RegionConstant& c : constants) print.add(c.reg, c.value);
    for (const std::size_t reg : initial) print.add(reg);
    for (const std::size_t reg : streams) print.add(reg);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const RegionRow& row = rows[i];
        require(row.a < terms + i && row.b < terms + i);
        require(row.kind == "MAP" || (row.kind == "WINDOW" && (row.lo || row.hi)));
        require(!row.guard || row.hi);
        print.add(row.kind, row.name, row.a, row.b, row.lo.value_or(kEver), row.hi.value_or(kEver),
                  row.guard, row.endless);
    }
    fingerprint_ = print.value();
    std::vector<Time> reaches(registers);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const RegionRow& row = rows[i];
        const Time lo = row.lo.value_or(0), hi = row.hi.value_or(0);
        require(-kEver <= lo && -kEver <= hi);
        const Time inner = std::max(reaches[row.a], reaches[row.b]);
        const Time own = std::max(std::abs(lo), std::abs(hi));
        require(own <= kEver - inner);
        reaches[terms + i] = inner + own;
        reach_ = std::max(reach_, inner + own);
    }
    const auto operand = [&](std::size_t reg) -> RegionStream& {
        require(streams_[reg] != nullptr);
        return *streams_[reg];
    };
    for (const std::size_t reg : order_) {
        require(reg < registers && streams_[reg] == nullptr);
        auto& made = streams_[reg];
        if (reg < terms) {
            if (constants_[reg]) made = std::make_unique<Constant>(*trace_, *constants_[reg]);
            else made = std::make_unique<Predicate>(*trace_);
            continue;
        }
        const RegionRow& row = rows[reg - terms];
        const RegionFold fold = fold_named(row.name);
        RegionStream &a = operand(row.a), &b = operand(row.b);
        if (row.kind == "MAP") {
            made = std::make_unique<Pointwise>(*trace_, fold, a, b);
        } else if (!row.hi) {
            const auto axis = std::find(unknowns.begin(), unknowns.end(), reg) - unknowns.begin();
            require(static_cast<std::size_t>(axis) < unknowns.size());
            made = std::make_unique<RegionFuture>(*trace_, row, fold, a, b,
                                                  static_cast<std::size_t>(axis));
        } else if (!row.lo) {
            made = std::make_unique<UnboundedPast>(*trace_, row, fold, a, b);
        } else {
            made = std::make_unique<Sliding>(*trace_, row, fold, a, b);
        }
    }
    for (const std::size_t reg : initial_) {
        require(reg < registers);
        if (reg < terms || rows[reg - terms].kind == "MAP") continue;
        const RegionRow& row = rows[reg - terms];
        folds_[reg] = std::make_unique<AtBegin>(*trace_, row, fold_named(row.name),
                                                operand(row.a), operand(row.b));
    }
}

Regions::Regions(Regions&&) noexcept = default;
Regions& Regions::operator=(Regions&&) noexcept = default;
Regions::~Regions() = default;

void Regions::advance(const Time* positions, const double* const* terms, std::size_t n, Time t) {
    if (t_ < 0) {
        first_.clear();
        for (std::size_t reg = 0; reg < terms_; ++reg) first_.push_back(terms[reg][0]);
    }
    t_ = t;
    for (const std::size_t reg : order_) {
        RegionStream& stream = *streams_[reg];
        if (auto* predicate = dynamic_cast<Predicate*>(&stream))
            predicate->take(positions, terms[reg], n);
        if (!stream.settle(t)) continue;
        if (const auto* future = dynamic_cast<const RegionFuture*>(&stream)) {
            const std::size_t axis = future->axis();
            std::vector<double> value(trace_->corners);
            for (std::size_t c = 0; c < value.size(); ++c) value[c] = stream.settling().at(0)[c].q;
            for (const auto& each : streams_)
                if (each) each->substitute(axis, value);
            for (const auto& fold : folds_)
                if (fold) fold->substitute(axis, value);
        }
        stream.keep(t);
    }
    for (const auto& fold : folds_)
        if (fold) fold->settle();
    for (const std::size_t reg : order_) streams_[reg]->trim();
}

Regions::Values Regions::look(std::size_t worlds) {
    for (const std::size_t reg : order_)
        for (std::size_t world = 0; world < worlds; ++world)
            streams_[reg]->look(world, t_, *trace_);
    std::vector<Values> found(terms_ + rows_.size());
    for (const std::size_t reg : initial_) found[reg] = at_zero(reg, found, worlds);
    return found[initial_.back()];
}

Regions::Values Regions::at_zero(std::size_t reg, const std::vector<Values>& found,
                                 std::size_t worlds) const {
    Values values{};
    if (reg < terms_) {
        if (constants_[reg]) {
            values.fill(*constants_[reg]);
        } else if (t_ >= 0) {
            values.fill(first_[reg]);
        } else {
            values = {-kInfinity, -kInfinity, kInfinity, -kInfinity, kInfinity};
        }
        return values;
    }
    const RegionRow& row = rows_[reg - terms_];
    const RegionFold fold = fold_named(row.name);
    for (std::size_t world = 0; world < worlds; ++world)
        values[world] = folds_[reg] ? folds_[reg]->value(world, t_)
                                    : fold.upper(found[row.a][world], found[row.b][world]);
    return values;
}

void Regions::reset() {
    t_ = -1;
    first_.clear();
    for (const std::size_t reg : order_) streams_[reg]->reset();
    for (const auto& fold : folds_)
        if (fold) fold->reset();
}

void Regions::fields(Snapshot& s) {
    s(t_);
    s.sized(first_);
    s.require(first_.size() == (t_ < 0 ? 0 : terms_));
    s.require(t_ >= -1 && (t_ < 0 || t_ % 2 == 0) && t_ <= kEver - reach_);
    for (const std::size_t reg : order_) {
        RegionStream& stream = *streams_[reg];
        stream.fields(s);
        s.require(stream.last() == std::max<Time>(-1, t_ - stream.late()));
    }
    for (const auto& fold : folds_)
        if (fold) fold->fields(s);
}

}  // namespace rtamt::dense
