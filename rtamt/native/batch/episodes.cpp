#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "batch/episodes.hpp"
#include "batch/initial_columns.hpp"

namespace rtamt::batch {
namespace {

// Episodes in columns: each instruction runs in all entries at once. For programs whose folds at
// time 0 are over min and max of predicates and of bounded windows of predicates.

// A register that is read at all times: the values where the only window that it reads is -inf and
// where it is +inf, which are one column if there is no window. Functions made of min and max of
// one operand, and of no negation, are clamps of it between those.
struct Range {
    std::size_t least;
    std::size_t greatest;
    std::optional<std::size_t> window;  // the row of the window
};

class Builder {
public:
    Builder(const episode::Program& program, std::size_t num)
        : program_(program),
          terms_(program.terms),
          num_(num),
          columns(terms_.size(), num),
          minus_(columns.constant(-kInfinity)),
          plus_(columns.constant(kInfinity)),
          ranges_(terms_.size() + program.formulas.size()),
          tails_(ranges_.size()) {}

    // Whether all registers can be columns; then they are made.
    bool build() {
        for (const std::size_t r : program_.streams) read(r);
        std::vector<InitialColumns*> made(ranges_.size());
        for (const std::size_t r : program_.initial) {
            std::unique_ptr<InitialColumns> value = initial_value(r, made);
            if (value == nullptr) return false;
            made[r] = value.get();
            initial_columns.push_back(std::move(value));
        }
        return true;
    }

private:
    const FormulaRow& formula(std::size_t r) const { return program_.formula(r); }
    static bool maps(const FormulaRow& f) { return f.kind == "MAP"; }
    static bool single(const FormulaRow& f) { return f.name == "min" || f.name == "max"; }
    static double choice(bool is_min, double x, double y) {
        return is_min ? lesser(x, y) : greater(x, y);
    }

    // Finds the range of a stream, if it has one, and its tail.
    void read(std::size_t r) {
        if (r < terms_.size()) {
            const DiscreteRow& row = terms_[r];
            ranges_[r] = Range{r, r, std::nullopt};
            tails_[r] = row.kind == "CONST" ? Tails{row.value, row.value, row.value}
                                            : Tails{0.0, -kInfinity, kInfinity};
            return;
        }
        const FormulaRow& f = formula(r);
        if (!single(f)) return;
        const bool is_min = f.name == "min";
        for (World w : kAll) tails_[r][w] = choice(is_min, tails_[f.a][w], tails_[f.b][w]);
        const auto& a = ranges_[f.a];
        const auto& b = ranges_[f.b];
        if (!a || !b) return;
        if (maps(f)) {
            if (a->window && b->window && *a->window != *b->window) return;
            Range range{map(is_min, a->least, b->least), 0, a->window ? a->window : b->window};
            range.greatest = range.window ? map(is_min, a->greatest, b->greatest) : range.least;
            ranges_[r] = range;
        } else if (!a->window && f.lo && f.hi && *f.lo == 0 && *f.hi > 0 && unknown(f.a)) {
            ranges_[r] = Range{minus_, plus_, r};
        }
    }

    // Whether nothing is known of a register at unseen samples: it is no constant, and none bounds
    // it.
    bool unknown(std::size_t r) const {
        return tails_[r][kLower] == -kInfinity && tails_[r][kUpper] == kInfinity;
    }

    std::size_t map(bool is_min, std::size_t a, std::size_t b) {
        const std::size_t zero = is_min ? minus_ : plus_;
        const std::size_t one = is_min ? plus_ : minus_;
        if (a == zero || b == zero) return zero;
        if (a == one || a == b) return b;
        return b == one ? a : columns.map(is_min, a, b);
    }

    std::unique_ptr<InitialColumns> initial_value(std::size_t r,
                                                  const std::vector<InitialColumns*>& made) {
        if (r < terms_.size()) {
            const DiscreteRow& row = terms_[r];
            return std::make_unique<TermColumns>(
                num_, r, row.kind == "CONST" ? std::optional<double>(row.value) : std::nullopt);
        }
        const FormulaRow& f = formula(r);
        if (!single(f)) return nullptr;
        const bool is_min = f.name == "min";
        if (maps(f)) {
            InitialColumns& a = *made[f.a];
            InitialColumns& b = *made[f.b];
            if (is_min) return std::make_unique<MapColumns<lesser>>(num_, a, b);
            return std::make_unique<MapColumns<greater>>(num_, a, b);
        }
        FoldOperand operand;
        operand.tail = tails_[f.a];
        operand.guard = f.guard;
        if (!split(f.a, f.name, operand)) return nullptr;
        const Time begin = std::max<Time>(0, f.lo.value_or(0));
        const Time end = f.hi.value_or(kNever);
        if (is_min) return std::make_unique<FoldColumns<Least>>(num_, operand, begin, end);
        return std::make_unique<FoldColumns<Most>>(num_, operand, begin, end);
    }

    // Splits the operand of a fold where its function is the fold's own; false if a part has no
    // range.
    bool split(std::size_t r, const std::string& name, FoldOperand& operand) const {
        std::vector<std::size_t> rest{r};
        std::vector<bool> known(ranges_.size());
        while (!rest.empty()) {
            const std::size_t part = rest.back();
            rest.pop_back();
            if (known[part]) continue;
            known[part] = true;
            const auto& range = ranges_[part];
            if (range && !range->window) {
                operand.plain.push_back(range->least);
            } else if (part >= terms_.size() && maps(formula(part)) && formula(part).name == name) {
                rest.push_back(formula(part).a);
                rest.push_back(formula(part).b);
            } else if (range) {
                const FormulaRow& window = formula(*range->window);
                operand.windows.push_back({ranges_[window.a]->least, range->least, range->greatest,
                                           *window.hi, window.name == "min", range->least != minus_,
                                           range->greatest != plus_});
            } else {
                return false;
            }
        }
        return true;
    }

    const episode::Program& program_;
    const std::vector<DiscreteRow>& terms_;
    std::size_t num_;

public:
    FormulaColumns columns;
    std::vector<std::unique_ptr<InitialColumns>> initial_columns;  // operands first

private:
    std::size_t minus_;
    std::size_t plus_;
    std::vector<std::optional<Range>> ranges_;
    std::vector<Tails> tails_;
};

class ColumnEpisodes final : public Episodes {
public:
    ColumnEpisodes(FormulaColumns columns, std::vector<std::unique_ptr<InitialColumns>> initial,
                   EpisodeValues& values)
        : columns_(std::move(columns)),
          initial_(std::move(initial)),
          values_(values),
          places_(values.samples.size()) {
        reset(Entries(values.samples.size()));
    }

    void take(const Entries& entries, const double*, RegisterColumns& terms) override {
        if (entries.count() == 0) return;
        std::int64_t* samples = values_.samples.data();
        places_.advance(entries, samples);
        columns_.find(terms, entries.count());
        Time first = std::numeric_limits<Time>::max();
        Time last = 0;
        each_stretch(
            entries, true, [&](std::size_t entry, std::size_t, std::size_t n) RTAMT_LOOP_BODY {
                Time least = first, most = last;
                for (const std::int64_t* s = samples + entry; s < samples + entry + n; ++s) {
                    least = std::min(least, *s);
                    most = std::max(most, *s);
                }
                first = least;
                last = most;
            });
        const Taken taken{entries, places_, samples, first, last, columns_};
        for (const auto& value : initial_) value->take(taken);
        each_stretch(entries, true,
                     [&](std::size_t entry, std::size_t, std::size_t n) RTAMT_LOOP_BODY {
                         for (std::size_t i = entry; i < entry + n; ++i) ++samples[i];
                     });
        conclude(entries, false);
    }

    void reset(const Entries& entries) override {
        places_.reset(entries);
        for (std::size_t i = 0; i < entries.count(); ++i) {
            values_.samples[entries[i]] = 0;
            values_.finished[entries[i]] = 0;
        }
        for (const auto& value : initial_) value->reset(entries);
        conclude(entries, false);
        for (std::size_t i = 0; i < entries.count(); ++i) values_.now[entries[i]] = std::nan("");
    }

    void finish(const Entries& entries, End end) override {
        std::vector<std::uint8_t> ending(values_.samples.size());
        for (std::size_t i = 0; i < entries.count(); ++i) {
            const std::uint32_t entry = entries[i];
            if (values_.finished[entry]) continue;
            ending[entry] = values_.finished[entry] = 1;
        }
        Entries rest(ending.size());
        rest.choose(ending.data());
        if (end == End::cut) conclude(rest, true);
        for (std::size_t i = 0; i < rest.count(); ++i) {
            double& now = values_.now[rest[i]];
            double& lower = values_.lower[rest[i]];
            double& upper = values_.upper[rest[i]];
            switch (end) {
                case End::complete:
                    lower = upper = now;
                    break;
                case End::cut:
                    now = moved(now, lower, upper);
                    break;
                case End::open:
                    break;
            }
        }
    }

    void fields(Snapshot& s) override {
        const std::size_t num = values_.samples.size();
        s.counts(values_.samples.data(), num);
        s.array(values_.finished.data(), num);
        for (double* values : {values_.now.data(), values_.lower.data(), values_.upper.data()})
            s.array(values, num);
        places_.fields(s);
        for (const auto& value : initial_) value->fields(s);
    }

private:
    void conclude(const Entries& entries, bool ended) {
        for (const auto& value : initial_) value->conclude(entries, values_.samples.data(), ended);
        InitialColumns& result = *initial_.back();
        each_stretch(entries, true, [&](std::size_t entry, std::size_t, std::size_t n) {
            std::copy_n(result.world(kNow) + entry, n, values_.now.data() + entry);
            std::copy_n(result.world(kLower) + entry, n, values_.lower.data() + entry);
            std::copy_n(result.world(kUpper) + entry, n, values_.upper.data() + entry);
        });
    }

    FormulaColumns columns_;
    std::vector<std::unique_ptr<InitialColumns>> initial_;
    EpisodeValues& values_;
    Places places_;
};

// A machine for each entry.
class MachineEpisodes final : public Episodes {
public:
    MachineEpisodes(const episode::Program& program, EpisodeValues& values)
        : values_(values), sample_(program.variables) {
        for (std::size_t entry = 0; entry < values.samples.size(); ++entry) {
            machines_.push_back(std::make_unique<EpisodeMachine>(program));
            publish(entry);
        }
    }

    void take(const Entries& entries, const double* inputs, RegisterColumns& terms) override {
        for (std::size_t i = 0; i < entries.count(); ++i) {
            const std::uint32_t entry = entries[i];
            for (std::size_t k = 0; k < sample_.size(); ++k)
                sample_[k] = inputs[k * entries.num() + entry];
            machines_[entry]->take(sample_.data(), terms.out(0) + i, entries.num());
            publish(entry);
        }
    }
    void reset(const Entries& entries) override {
        for (std::size_t i = 0; i < entries.count(); ++i) {
            machines_[entries[i]]->reset();
            publish(entries[i]);
        }
    }
    void finish(const Entries& entries, End end) override {
        for (std::size_t i = 0; i < entries.count(); ++i) {
            machines_[entries[i]]->finish(end);
            publish(entries[i]);
        }
    }
    void fields(Snapshot& s) override {
        for (std::size_t entry = 0; entry < machines_.size(); ++entry) {
            machines_[entry]->fields(s);
            publish(entry);
        }
    }

private:
    void publish(std::size_t entry) {
        const EpisodeMachine& machine = *machines_[entry];
        values_.samples[entry] = machine.samples();
        values_.finished[entry] = machine.finished();
        values_.now[entry] = machine.result();
        values_.lower[entry] = machine.lower();
        values_.upper[entry] = machine.upper();
    }

    EpisodeValues& values_;
    std::vector<double> sample_;
    std::vector<std::unique_ptr<EpisodeMachine>> machines_;
};

}  // namespace

std::unique_ptr<Episodes> episodes_of(const episode::Program& program, EpisodeValues& values) {
    Builder builder(program, values.samples.size());
    if (!builder.build()) return std::make_unique<MachineEpisodes>(program, values);
    return std::make_unique<ColumnEpisodes>(std::move(builder.columns),
                                            std::move(builder.initial_columns), values);
}

}  // namespace rtamt::batch
