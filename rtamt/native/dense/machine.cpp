#include "dense/machine.hpp"

#include <cmath>
#include <stdexcept>
#include <utility>

#include "dense/window.hpp"

namespace rtamt {

using namespace dense;

namespace {

[[noreturn]] void refuse(const std::string& what) { throw std::invalid_argument(what); }

const std::vector<DenseRow>& checked(const std::vector<DenseRow>& rows, std::size_t variables,
                                     std::size_t result, const std::vector<std::size_t>& observed) {
    if (variables == 0) refuse("expected a variable");
    if (result >= rows.size()) refuse("the result is out of range");
    for (const std::size_t i : observed)
        if (i >= rows.size()) refuse("an observed register is out of range");
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const DenseRow& row = rows[i];
        const bool load = row.kind == "LOAD";
        const bool map = row.kind == "MAP";
        const bool window = row.kind == "WINDOW";
        if (!load && !map && !window && row.kind != "CONST")
            refuse("unknown kind '" + row.kind + "'");
        if (map && !function_named(row.name)) refuse("unknown function '" + row.name + "'");
        if (row.a >= (load            ? variables
                      : map || window ? i
                                      : rows.size()) ||
            ((map || window) && row.b >= i) || !counts(row.lo.value_or(0)) ||
            !counts(row.hi.value_or(0)) || (row.lo && row.hi && *row.lo > *row.hi))
            refuse("row " + std::to_string(i) + " is out of range");
    }
    return rows;
}

std::uint64_t fingerprint_of(const std::vector<DenseRow>& rows, const std::vector<double>& declared,
                             std::size_t result, const std::vector<std::size_t>& observed) {
    Fingerprint print;
    print.add(std::string("dense"), declared.size(), result);
    for (const double value : declared) print.add(value);
    for (const std::size_t i : observed) print.add(i);
    for (const DenseRow& row : rows)
        print.add(row.kind, row.name, row.a, row.b, row.value, row.lo.value_or(kBefore),
                  row.hi.value_or(kAfter));
    return print.value();
}

}  // namespace

DenseMachine::DenseMachine(const std::vector<DenseRow>& rows, std::size_t terms,
                           const std::vector<double>& declared, std::size_t result,
                           const std::vector<std::size_t>& observed)
    : EventMachine(checked(rows, declared.size(), result, observed), terms, declared),
      streams_(rows.size()) {
    fingerprint_ = fingerprint_of(rows, declared, result, observed);
    std::vector<bool> read(rows.size());
    read[result] = true;
    for (const std::size_t i : observed) read[i] = true;
    for (std::size_t i = 0; i < rows.size(); ++i) {
        if (sampler_.samples(i)) continue;
        read[rows[i].a] = read[rows[i].b] = true;
        compile(i, rows[i]);
    }
    for (std::size_t i = 0; i < rows.size(); ++i)
        if (read[i] && sampler_.samples(i)) published_.push_back(i);
    result_ = observe(result);
    for (const std::size_t i : observed) observed_.push_back(observe(i));
}

void DenseMachine::compile(std::size_t i, const DenseRow& row) {
    Joint in;
    in.add(streams_[row.a]);
    if (row.b != row.a) in.add(streams_[row.b]);
    if (row.kind == "MAP") {
        nodes_.push_back(
            std::make_unique<MapNode>(std::move(in), function_named(row.name), streams_[i]));
        return;
    }
#define RTAMT_NAMED(name_, Type)                                                             \
    if (row.name == #name_) {                                                                \
        nodes_.push_back(                                                                    \
            std::make_unique<WindowNode<Type>>(std::move(in), row.lo, row.hi, streams_[i])); \
        return;                                                                              \
    }
    RTAMT_FOLDS(RTAMT_NAMED)
#undef RTAMT_NAMED
    refuse("unknown lattice fold '" + row.name + "'");
}

bool DenseMachine::take() {
    extend();
    const bool brief = sampler_.brief();
    if (!brief && !sampler_.rehearse()) {
        retract();
        return false;
    }
    while (sampler_.read()) {
        if (!sampler_.evaluate()) {
            retract();
            return false;
        }
        proceed();
        if (brief) break;
    }
    if (!sampler_.started()) settle(sampler_.known());
    if (!brief) trim();
    return true;
}

// Frees the memory that a long chunk needed.
void DenseMachine::trim() {
    bool any = false;
    for (Pending& pending : pending_) {
        if (pending.times.size() <= kBlock) continue;
        pending = {};
        any = true;
    }
    if (!any) return;
    sampler_.trim();
    for (Stream& stream : streams_) stream.trim();
}

void DenseMachine::proceed() {
    if (!sampler_.started())
        for (const auto& node : nodes_) node->begin(sampler_.upto());
    for (const std::size_t i : published_)
        streams_[i].append(sampler_.times(), sampler_.column(i), sampler_.size());
    sampler_.consume();
    settle(sampler_.upto());
}

void DenseMachine::settle(Time known) {
    for (const std::size_t i : published_) streams_[i].settle(known);
    for (const auto& node : nodes_) node->advance(known);
}

Time DenseMachine::settled() const {
    return finished_ ? sampler_.known() : result_.stream->frontier();
}

std::vector<double> DenseMachine::values() const {
    std::vector<double> values;
    for (const Observer& o : observed_) values.push_back(o.stream->values(o.reader)[-1]);
    return values;
}

std::size_t DenseMachine::Observer::fresh() const {
    const Time* times = stream->times(reader);
    std::size_t n = stream->unread(reader);
    while (n > 0 && !(times[n - 1] < stream->frontier())) --n;
    return n;
}

bool DenseMachine::finish() {
    if (!sampler_.started()) return false;
    const Time end = sampler_.known();
    const Time after = end + 1;
    for (const std::size_t i : published_) streams_[i].settle(after);
    for (const auto& node : nodes_) node->finish(end, after);
    finished_ = true;
    return true;
}

void DenseMachine::reset() {
    EventMachine::reset();
    for (Stream& stream : streams_) stream.clear();
    for (const auto& node : nodes_) node->reset();
}

void DenseMachine::fields(Snapshot& s) {
    s(finished_, dating_);
    s.require(dating_ <= Dating::dates);
    sampler_.fields(s);
    for (Stream& stream : streams_) stream.fields(s);
    for (const auto& node : nodes_) node->fields(s);
}

}  // namespace rtamt
