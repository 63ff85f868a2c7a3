#include "dense/sampler.hpp"

#include "core/columns.hpp"
#include "core/functions.hpp"

namespace rtamt::dense {

Function function_named(const std::string& name) {
#define RTAMT_NAMED(name_, arity, value) \
    if (name == #name_) return columns::map<functions::name_>;
    RTAMT_FUNCTIONS(RTAMT_NAMED)
#undef RTAMT_NAMED
    return nullptr;
}

Sampler::Sampler(const std::vector<DenseRow>& rows, std::size_t terms,
                 const std::vector<double>& declared)
    : inputs_(declared.begin(), declared.end()), sampled_(rows.size()), columns_(rows.size()) {
    for (const double value : declared) declared_.push_back(value == value);
    for (Stream& input : inputs_) joint_.add(input);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const DenseRow& row = rows[i];
        if (row.kind == "LOAD") {
            loads_.push_back({i, row.a});
        } else if (row.kind == "CONST") {
            constants_.push_back({i, row.value});
        } else if (row.kind == "MAP" && sampled_[row.a] && sampled_[row.b]) {
            operations_.push_back({function_named(row.name), i, row.a, row.b, i < terms});
        } else {
            continue;
        }
        sampled_[i] = true;
    }
}

bool Sampler::fit(Time last, Events events) {
    bool fit = true;
    for (std::size_t i = 0; i < events.size; ++i) {
        fit &= (events.times[i] > last) & (events.values[i] == events.values[i]);
        last = events.times[i];
    }
    return fit && last < kTicks;
}

void Sampler::extend(const Events* events) {
    for (std::size_t v = 0; v < inputs_.size(); ++v)
        inputs_[v].extend(events[v].times, events[v].values, events[v].size);
}

void Sampler::retract(const Events* events) {
    for (std::size_t v = 0; v < inputs_.size(); ++v) inputs_[v].retract(events[v].size);
}

Time Sampler::known() const {
    Time least = kAfter;
    for (std::size_t v = 0; v < inputs_.size(); ++v) {
        const Time last = inputs_[v].last_time();
        if (last > kBefore || !declared_[v]) least = std::min(least, last);
    }
    return least == kAfter ? kBefore : least;
}

Time Sampler::begin() const {
    Time latest = kBefore, earliest = kAfter;
    for (std::size_t v = 0; v < inputs_.size(); ++v) {
        const Time first = first_time(v);
        earliest = std::min(earliest, first);
        if (!declared_[v]) latest = std::max(latest, first);
    }
    return latest == kBefore ? earliest : latest;
}

bool Sampler::read(Time known) {
    if (started_) {
        upto_ = joint_.upto(known, kBlock);
        joint_.read([upto = upto_](Time time) { return time <= upto; });
        return joint_.size() > 0;
    }
    const Time first = begin();
    if (!(first <= known)) return false;
    joint_.read_at(first);
    upto_ = first;
    return true;
}

bool Sampler::evaluate() {
    const std::size_t n = joint_.size();
    if (n > capacity_) enlarge(n);
    for (const Load& load : loads_) columns_[load.out] = joint_.column(load.variable);
    double* out = memory_.data() + constants_.size() * capacity_;
    std::size_t bad = n;
    for (const Operation& operation : operations_) {
        operation.function(columns_[operation.a], columns_[operation.b], out, n);
        if (operation.term) bad = columns::first_nan(out, bad);
        columns_[operation.out] = out;
        out += capacity_;
    }
    if (bad == n) return true;
    nan_time_ = joint_.times()[bad];
    nan_values_.clear();
    for (std::size_t v = 0; v < inputs_.size(); ++v) nan_values_.push_back(joint_.column(v)[bad]);
    return false;
}

void Sampler::enlarge(std::size_t n) {
    capacity_ = std::max(n, 2 * capacity_);
    memory_.resize((constants_.size() + operations_.size()) * capacity_);
    double* column = memory_.data();
    for (const Const& constant : constants_) {
        std::fill_n(column, capacity_, constant.value);
        columns_[constant.out] = column;
        column += capacity_;
    }
}

void Sampler::consume() {
    joint_.consume();
    started_ = true;
}

bool Sampler::rehearse() {
    const auto unread = joint_.unread();
    const bool started = started_;
    bool fine = true;
    while (fine && read()) {
        fine = evaluate();
        consume();
    }
    joint_.rewind(unread);
    started_ = started;
    return fine;
}

void Sampler::reset() {
    for (Stream& input : inputs_) input.clear();
    started_ = false;
}

void Sampler::fields(Snapshot& s) {
    s(started_);
    for (Stream& input : inputs_) {
        input.fields(s);
    }
    s.require(!started_ || known() > kBefore);
}

}  // namespace rtamt::dense
