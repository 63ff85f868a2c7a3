#include "lockstep/bank.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "core/columns.hpp"

namespace rtamt {

Lanes::Lanes(std::size_t num) : all_(num), chosen_(all_.data()) {
    std::iota(all_.begin(), all_.end(), 0u);
    some_.reserve(num);
}

void Lanes::choose(const bool* mask) {
    chosen_ = all_.data();
    if (mask == nullptr) return;
    some_.clear();
    for (const std::uint32_t lane : all_)
        if (mask[lane]) some_.push_back(lane);
    chosen_ = some_.data();
}

LaneColumns::LaneColumns(const DiscreteMachine& program, std::size_t num)
    : program_(program),
      num_(num),
      memory_(std::make_unique_for_overwrite<double[]>(program.initial_.size() * num)),
      at_(program.initial_.size()) {
    for (std::size_t slot = 0; slot < at_.size(); ++slot) {
        at_[slot] = out(slot);
        std::fill_n(out(slot), num, program.initial_[slot]);
    }
}

std::size_t LaneColumns::terms(const double* table, const Lanes& lanes) {
    const std::size_t count = lanes.count();
    const std::size_t width = program_.variables_;
    for (const Load& load : program_.loads_) {
        double* column = out(load.out);
        const double* from = table + load.variable;
        for (std::size_t i = 0; i < count; ++i) column[i] = from[lanes[i] * width];
    }
    for (const Step& step : program_.terms_) map(step, count);
    std::size_t first = count;
    for (const Load& load : program_.loads_) first = columns::first_nan(at(load.out), first);
    for (const Step& step : program_.terms_) first = columns::first_nan(at(step.out), first);
    return first;
}

void LaneColumns::map(const Step& step, std::size_t count) {
    const double* a = at(step.a);
    const double* b = at(step.b);
    switch (step.opcode) {
#define RTAMT_CASE(name, arity, value)                       \
    case Opcode::map_##name:                                 \
        columns::map_##name(a, b, out(step.out), count);     \
        break;
        RTAMT_FUNCTIONS(RTAMT_CASE)
#undef RTAMT_CASE
    default:  // there are no others
        break;
    }
}

DiscreteBank::DiscreteBank(const std::vector<Row>& rows, std::size_t terms, std::size_t variables,
           const Observed& result, std::size_t num)
    : program_(rows, terms, variables, {result}),
      columns_(program_, num),
      lanes_(num),
      samples_(num),
      inputs_(num * variables),
      results_(num, std::nan("")) {
    for (const Step& step : program_.formulas_) formulas_.push_back({step, {}});
    for (std::size_t lane = 0; lane < num; ++lane) {
        DiscreteMachine machine(rows, terms, variables, {result});
        for (std::size_t i = 0; i < formulas_.size(); ++i)
            formulas_[i].parts.push_back(machine.formulas_[i].part);
        for (auto& part : machine.parts_) parts_.push_back(std::move(part));
    }
}

std::size_t DiscreteBank::take(const double* table, const bool* mask) {
    lanes_.choose(mask);
    const std::size_t count = lanes_.count();
    const std::size_t width = variables();
    if (const std::size_t bad = columns_.terms(table, lanes_); bad < count) return lanes_[bad];
    least_ = std::numeric_limits<std::int64_t>::max();
    for (std::size_t i = 0; i < count; ++i) least_ = std::min(least_, samples_[lanes_[i]]);
    for (const LaneStep& step : formulas_) execute(step);
    const Observed& result = program_.observed_.front();
    const double* values = columns_.at(result.slot);
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint32_t lane = lanes_[i];
        std::copy_n(table + lane * width, width, inputs_.data() + lane * width);
        if (++samples_[lane] > result.latency) results_[lane] = values[i];
    }
    return num();
}

void DiscreteBank::execute(const LaneStep& lane_step) {
    const Step& step = lane_step.step;
    switch (step.opcode) {
#define RTAMT_CASE(name, Type)                  \
    case Opcode::latest_##name:                 \
        push<Latest<Type>>(lane_step);          \
        break;                                  \
    case Opcode::running_##name:                \
        push<Running<Type>>(lane_step);         \
        break;                                  \
    case Opcode::sliding_##name:                \
        push<Sliding<Type>>(lane_step);         \
        break;
        RTAMT_FOLDS(RTAMT_CASE)
#undef RTAMT_CASE
    case Opcode::delay: {
        const double* a = columns_.at(step.a);
        double* out = columns_.out(step.out);
        for (std::size_t i = 0; i < lanes_.count(); ++i)
            out[i] = static_cast<Delay*>(lane_step.parts[lanes_[i]])->push(a[i]);
        break;
    }
    default:
        columns_.map(step, lanes_.count());
    }
}

template <class Fold>
void DiscreteBank::push(const LaneStep& lane_step) {
    using M = typename Fold::Monoid;
    const Step& step = lane_step.step;
    const double* a = columns_.at(step.a);
    const double* b = columns_.at(step.b);
    double* out = columns_.out(step.out);
    Part* const* parts = lane_step.parts.data();
    const std::size_t count = lanes_.count();
    const auto push_to = [&](std::size_t i, typename M::Element x) {
        out[i] = M::result(static_cast<Fold*>(parts[lanes_[i]])->push(x));
    };
    if (least_ >= step.start) {
        for (std::size_t i = 0; i < count; ++i) push_to(i, M::element(a[i], b[i]));
    } else {
        for (std::size_t i = 0; i < count; ++i)
            push_to(i, samples_[lanes_[i]] >= step.start ? M::element(a[i], b[i]) : M::identity);
    }
}

void DiscreteBank::reset(const bool* mask) {
    lanes_.choose(mask);
    const std::size_t each = parts_.size() / num();
    for (std::size_t i = 0; i < lanes_.count(); ++i) {
        const std::uint32_t lane = lanes_[i];
        samples_[lane] = 0;
        results_[lane] = std::nan("");
        std::fill_n(inputs_.data() + lane * variables(), variables(), 0.0);
        for (std::size_t part = lane * each; part < (lane + 1) * each; ++part)
            parts_[part]->reset();
    }
}

std::string DiscreteBank::state() const {
    Writer out;
    out.put(program_.mark());
    out.put<std::uint64_t>(num());
    out.put(samples_.data(), num());
    out.put(inputs_.data(), inputs_.size());
    out.put(results_.data(), num());
    for (const auto& part : parts_) part->save(out);
    return out.bytes();
}

void DiscreteBank::restore(std::string_view bytes) {
    Reader in(bytes);
    if (bytes.size() < 2 * sizeof(std::uint64_t) || in.get<std::uint64_t>() != program_.mark() ||
        in.get<std::uint64_t>() != num())
        throw std::invalid_argument(kForeign);
    try {
        reset(nullptr);
        in.get(samples_.data(), num());
        for (const std::int64_t samples : samples_) Reader::require(samples >= 0);
        in.get(inputs_.data(), inputs_.size());
        in.get(results_.data(), num());
        for (const auto& part : parts_) part->load(in);
        Reader::require(in.empty());
    } catch (const std::invalid_argument&) {
        reset(nullptr);
        throw;
    }
}

EpisodeBank::EpisodeBank(const std::vector<Row>& terms, std::size_t variables,
                         const std::vector<episode::Formula>& formulas,
                         const std::vector<std::size_t>& tops,
                         const std::vector<std::size_t>& streams, std::size_t num)
    : program_(terms, terms.size(), variables, {{0, 0}}),
      columns_(program_, num),
      lanes_(num),
      inputs_(num * variables),
      robustness_(num),
      lower_(num),
      upper_(num) {
    for (std::size_t lane = 0; lane < num; ++lane) {
        machines_.push_back(
            std::make_unique<EpisodeMachine>(terms, variables, formulas, tops, streams));
        look_at(lane);
    }
    if (machines_.empty()) throw std::invalid_argument("expected a lane, got none");
    const std::string state = machines_.front()->state();  // which begins with the program's mark
    mark_ = Reader(state).get<std::uint64_t>();
}

std::size_t EpisodeBank::take(const double* table, const bool* mask) {
    lanes_.choose(mask);
    const std::size_t count = lanes_.count();
    const std::size_t width = variables();
    if (const std::size_t bad = columns_.terms(table, lanes_); bad < count) return lanes_[bad];
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint32_t lane = lanes_[i];
        const double* inputs = table + lane * width;
        columns_.hand_to(*machines_[lane], inputs, i);
        std::copy_n(inputs, width, inputs_.data() + lane * width);
        look_at(lane);
    }
    return num();
}

void EpisodeBank::look_at(std::size_t lane) {
    robustness_[lane] = machines_[lane]->result();
    lower_[lane] = machines_[lane]->lower();
    upper_[lane] = machines_[lane]->upper();
}

void EpisodeBank::reset(const bool* mask) {
    lanes_.choose(mask);
    for (std::size_t i = 0; i < lanes_.count(); ++i) {
        machines_[lanes_[i]]->reset();
        std::fill_n(inputs_.data() + lanes_[i] * variables(), variables(), 0.0);
        look_at(lanes_[i]);
    }
}

void EpisodeBank::finish(const bool* mask) {
    lanes_.choose(mask);
    for (std::size_t i = 0; i < lanes_.count(); ++i) {
        machines_[lanes_[i]]->finish();
        look_at(lanes_[i]);
    }
}

std::string EpisodeBank::state() const {
    Writer out;
    out.put(mark_);
    out.put<std::uint64_t>(num());
    for (const auto& machine : machines_) {
        const std::string state = machine->state();
        out.put<std::uint64_t>(state.size());
        out.put(state.data(), state.size());
    }
    return out.bytes();
}

void EpisodeBank::restore(std::string_view bytes) {
    Reader in(bytes);
    if (bytes.size() < 2 * sizeof(std::uint64_t) || in.get<std::uint64_t>() != mark_ ||
        in.get<std::uint64_t>() != num())
        throw std::invalid_argument(kForeign);
    try {
        for (std::size_t lane = 0; lane < num(); ++lane) {
            EpisodeMachine& machine = *machines_[lane];
            machine.restore(in.bytes(in.get<std::uint64_t>()));
            if (machine.samples() > 0)
                std::copy_n(machine.inputs(), variables(), inputs_.data() + lane * variables());
            look_at(lane);
        }
        Reader::require(in.empty());
    } catch (const std::invalid_argument&) {
        reset(nullptr);
        throw;
    }
}

}  // namespace rtamt
