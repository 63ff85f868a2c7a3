#include "dense/episode.hpp"

#include <algorithm>
#include <stdexcept>

namespace rtamt {

using namespace dense;

namespace {

// The rows of all readings, one behind the other. Throws std::invalid_argument on rows that are no
// terms.
std::vector<DenseRow> joined_terms(const std::vector<RegionProgram>& readings,
                                   std::size_t variables) {
    std::vector<DenseRow> rows;
    for (const RegionProgram& reading : readings) {
        const std::size_t first = rows.size();
        for (std::size_t i = 0; i < reading.terms.size(); ++i) {
            DenseRow row = reading.terms[i];
            if (!is_term(row, i, variables))
                throw std::invalid_argument("row " + std::to_string(i) + " is no term");
            if (row.kind == "MAP") row.a += first, row.b += first;
            rows.push_back(std::move(row));
        }
    }
    if (rows.empty() || variables == 0) throw std::invalid_argument("expected terms of variables");
    return rows;
}

std::size_t count_terms(const std::vector<RegionProgram>& readings) {
    std::size_t count = 0;
    for (const RegionProgram& reading : readings) count += reading.terms.size();
    return count;
}

Regions regions_of(const RegionProgram& program) {
    std::vector<RegionConstant> constants;
    for (std::size_t i = 0; i < program.terms.size(); ++i)
        if (program.terms[i].kind == "CONST") constants.push_back({i, program.terms[i].value});
    return Regions(program.terms.size(), constants, program.rows, program.initial, program.streams,
                   program.unknowns);
}

}  // namespace

DenseEpisodeMachine::DenseEpisodeMachine(const std::vector<RegionProgram>& readings,
                                         const std::vector<double>& declared, Time reach,
                                         bool decides)
    : EventMachine(joined_terms(readings, declared.size()), count_terms(readings), declared),
      reach_(reach),
      decides_(decides) {
    if (reach < 0 || reach >= kTicks) throw std::invalid_argument("the reach is out of range");
    Fingerprint print;
    print.add(std::string("dense episode"), declared.size(), reach, decides);
    for (const double value : declared) print.add(value);
    for (const RegionProgram& reading : readings) {
        readings_.push_back(regions_of(reading));
        print.add(readings_.back().fingerprint());
        for (const DenseRow& row : reading.terms)
            print.add(row.kind, row.name, row.a, row.b, row.value);
    }
    fingerprint_ = print.value();
    new_ = journal_ = Columns(count_terms(readings));
    reset();
}

void DenseEpisodeMachine::Columns::add(const Columns& others) {
    positions.insert(positions.end(), others.positions.begin(), others.positions.end());
    for (std::size_t r = 0; r < terms.size(); ++r)
        terms[r].insert(terms[r].end(), others.terms[r].begin(), others.terms[r].end());
}

void DenseEpisodeMachine::Columns::clear() {
    positions.clear();
    for (std::vector<double>& term : terms) term.clear();
}

std::size_t DenseEpisodeMachine::Columns::place(Time position) const {
    return static_cast<std::size_t>(std::upper_bound(positions.begin(), positions.end(), position) -
                                    positions.begin());
}

std::uint64_t DenseEpisodeMachine::length(Time known) const {
    const Time begin = sampler_.started() ? begin_ : sampler_.begin();
    if (begin > known) return 0;
    return static_cast<std::uint64_t>(known - begin) + static_cast<std::uint64_t>(reach_);
}

// Adds the positions of the times that the sampler has read.
void DenseEpisodeMachine::append_positions(std::vector<Time>& to) const {
    const std::size_t n = sampler_.size();
    const Time* times = sampler_.times();
    for (std::size_t i = 0; i < n; ++i)  // too long a trace is found later
        to.push_back(static_cast<Time>(
            2 * (static_cast<std::uint64_t>(times[i]) - static_cast<std::uint64_t>(begin_))));
}

// Adds the terms there too.
void DenseEpisodeMachine::append(Columns& to) const {
    append_positions(to.positions);
    for (std::size_t r = 0; r < to.terms.size(); ++r) {
        const double* column = sampler_.column(r);
        to.terms[r].insert(to.terms[r].end(), column, column + sampler_.size());
    }
}

DenseEpisodeMachine::Taken DenseEpisodeMachine::take() {
    const Time before = settled();
    extend();
    const Time known = sampler_.known();
    const bool brief = sampler_.brief(known);
    const bool fine = brief ? !sampler_.read(known) || sampler_.evaluate() : sampler_.rehearse();
    if (!fine || length(known) >= static_cast<std::uint64_t>(kTicks)) {
        too_long_ = length(known);
        retract();
        return fine ? Taken::too_long : Taken::no_number;
    }
    const bool open = decides_ && decided_ < 0;
    if (brief && !open) {
        take_block(before, known);
        return Taken::all;
    }
    new_.clear();
    while (brief ? sampler_.size() > 0 : sampler_.read()) {
        if (!brief) sampler_.evaluate();  // which was rehearsed
        if (!sampler_.started()) begin_ = sampler_.upto();
        append(new_);
        sampler_.consume();
        if (brief) break;
    }
    if (settled() == before) return Taken::all;
    if (open) {
        const std::size_t size = journal_.positions.size() * (journal_.terms.size() + 1);
        constexpr std::size_t kLeast = 128;
        if (size > std::max(kLeast, journal_state_.size() / sizeof(double))) begin_journal();
        journal_.add(new_);
    }
    advance(new_, settled() - begin_);
    conclude();
    if (open && verdict() != 0) decide();
    if (new_.positions.size() > kBlock) new_ = Columns(new_.terms.size());
    return Taken::all;
}

// Takes in the terms at the times that the sampler has evaluated, where they are.
void DenseEpisodeMachine::take_block(Time before, Time known) {
    new_.positions.clear();
    append_positions(new_.positions);
    sampler_.consume();
    if (known == before) return;
    std::size_t r = 0;
    for (Regions& reading : readings_) {
        sources_.clear();
        for (std::size_t i = 0; i < reading.terms(); ++i) sources_.push_back(sampler_.column(r++));
        reading.advance(new_.positions.data(), sources_.data(), new_.positions.size(),
                        2 * (known - begin_));
    }
    conclude();
}

DenseEpisodeMachine::Taken DenseEpisodeMachine::run(const Events* events, bool decides) {
    new_.clear();
    Parts parts(events, sampler_.variables());
    while (const Events* part = parts.next()) {
        sampler_.extend(part);
        while (sampler_.read()) {
            if (!sampler_.evaluate()) return Taken::no_number;
            if (!sampler_.started()) begin_ = sampler_.upto();
            append(new_);
            sampler_.consume();
        }
    }
    if (!sampler_.started()) return Taken::all;
    too_long_ = length(settled());
    if (too_long_ >= static_cast<std::uint64_t>(kTicks)) return Taken::too_long;
    advance(new_, settled() - begin_);
    conclude();
    if (decides && verdict() != 0) {
        std::swap(journal_, new_);
        decide();
    }
    new_ = Columns(new_.terms.size());
    return Taken::all;
}

void DenseEpisodeMachine::advance(const Columns& columns, Time tick) {
    const Time t = 2 * tick;
    const std::size_t first = columns.place(readings_.front().last());
    const std::size_t after = columns.place(t);
    std::size_t r = 0;
    for (Regions& reading : readings_) {
        sources_.clear();
        for (std::size_t i = 0; i < reading.terms(); ++i)
            sources_.push_back(columns.terms[r++].data() + first);
        reading.advance(columns.positions.data() + first, sources_.data(), after - first, t);
    }
}

void DenseEpisodeMachine::conclude() {
    constexpr std::size_t kOpen = Regions::upper + 1;
    const Regions::Values worst = readings_.front().look(kOpen);
    const Regions::Values best = readings_.size() > 1 ? readings_.back().look(kOpen) : worst;
    lower_ = worst[Regions::lower];
    upper_ = best[Regions::upper];
    robustness_ = readings_.front().last() < 0 ? std::numeric_limits<double>::quiet_NaN()
                                               : best[Regions::now];
}

// Finds the first tick that decides: bounds never widen.
void DenseEpisodeMachine::decide() {
    Time low = journal_tick_, high = settled() - begin_;
    std::string state = journal_state_;
    const std::string found = reading_state();
    const double robustness = robustness_, lower = lower_, upper = upper_;
    while (high - low > 1) {
        const Time middle = low + (high - low) / 2;
        restore_readings(state);
        advance(journal_, middle);
        conclude();
        if (verdict() == 0) {
            low = middle;
            state = reading_state();
        } else {
            high = middle;
        }
    }
    decided_ = high;
    restore_readings(found);
    robustness_ = robustness;
    lower_ = lower;
    upper_ = upper;
    journal_ = Columns(journal_.terms.size());
    journal_state_.clear();
}

void DenseEpisodeMachine::begin_journal() {
    journal_state_ = reading_state();
    journal_tick_ = readings_.front().last() < 0 ? -1 : readings_.front().last() / 2;
    journal_.clear();
}

std::vector<double> DenseEpisodeMachine::complete() {
    std::vector<double> found;
    for (Regions& reading : readings_) found.push_back(reading.look(1)[Regions::now]);
    return found;
}

void DenseEpisodeMachine::finish(End end) {
    switch (end) {
        case End::complete: {
            const std::vector<double> found = complete();
            lower_ = found.front();
            robustness_ = upper_ = found.back();
            break;
        }
        case End::cut:
            lower_ = readings_.front().look(Regions::worlds)[Regions::cut_lower];
            upper_ = readings_.back().look(Regions::worlds)[Regions::cut_upper];
            robustness_ = moved(robustness_, lower_, upper_);
            break;
        case End::open:
            break;
    }
    finished_ = true;
}

void DenseEpisodeMachine::reset() {
    EventMachine::reset();
    for (Regions& reading : readings_) reading.reset();
    begin_ = 0;
    decided_ = -1;
    if (decides_) begin_journal();
    conclude();
}

void DenseEpisodeMachine::reading_fields(Snapshot& s) {
    for (Regions& reading : readings_) reading.fields(s);
}

std::string DenseEpisodeMachine::reading_state() {
    Snapshot out;
    reading_fields(out);
    return std::move(out).written();
}

void DenseEpisodeMachine::restore_readings(const std::string& state) {
    Snapshot in{std::string_view(state)};
    for (Regions& reading : readings_) reading.reset();
    reading_fields(in);
}

void DenseEpisodeMachine::fields(Snapshot& s) {
    s(finished_, dating_, begin_, decided_);
    s.require(dating_ <= Dating::dates && counts(begin_) && decided_ >= -1);
    sampler_.fields(s);
    reading_fields(s);
    const Time t = sampler_.started() ? settled() - begin_ : -1;
    if (s.reads()) {
        s.require(!sampler_.started() ||
                  (begin_ <= settled() && length(settled()) < static_cast<std::uint64_t>(kTicks)));
        for (const Regions& reading : readings_) s.require(reading.last() == (t < 0 ? -1 : 2 * t));
        s.require(decided_ <= t && !(finished_ && t < 0));
    }
    s(robustness_);
    s.require((robustness_ != robustness_) == (t < 0));
    s.numbers(&lower_, 1);
    s.numbers(&upper_, 1);
    if (s.reads() && decides_ && decided_ < 0) begin_journal();
}

}  // namespace rtamt
