#include "episode/machine.hpp"

#include <cmath>
#include <stdexcept>
#include <utility>

#include "episode/initial.hpp"
#include "episode/pointwise.hpp"
#include "episode/sliding.hpp"
#include "episode/unbounded.hpp"

namespace rtamt {

using namespace episode;

namespace {

[[noreturn]] void refuse(const std::string& what) { throw std::invalid_argument(what); }

// Makes an object of a class of a fold that is given by name, over its operands.
template <template <class> class Class, class Base, class... Args>
std::unique_ptr<Base> of_fold(const std::string& name, Workspace& workspace, Stream& p, Stream& q,
                              Args... args) {
#define RTAMT_NAMED(name_, Type) \
    if (name == #name_)          \
        return std::make_unique<Class<Type>>(workspace, Operands<Type>(p, q), args...);
    RTAMT_FOLDS(RTAMT_NAMED)
#undef RTAMT_NAMED
    refuse("unknown lattice fold '" + name + "'");
}

template <template <class> class Class, class Base, class... Args>
std::unique_ptr<Base> of_choice(const std::string& name, Args&&... args) {
    if (name == "min") return std::make_unique<Class<Min>>(std::forward<Args>(args)...);
    if (name == "max") return std::make_unique<Class<Max>>(std::forward<Args>(args)...);
    refuse("function '" + name + "' is not monotone");
}

Role role_of(const FormulaRow& f) {
    if (!f.endless) return {f.guard, std::nullopt};
    return {f.guard, f.guard ? f.hi.value_or(0) + 1 : f.lo.value_or(0)};
}

std::uint64_t fingerprint_of(std::uint64_t terms, const std::vector<FormulaRow>& formulas) {
    Fingerprint print;
    print.add(terms);
    for (const FormulaRow& f : formulas)
        print.add(f.kind, f.name, f.a, f.b, f.lo.value_or(-kNever), f.hi.value_or(kNever), f.guard,
                  f.endless);
    return print.value();
}

}  // namespace

class EpisodeMachine::Builder {
public:
    Builder(EpisodeMachine& machine, const Program& program)
        : machine_(machine),
          program_(program),
          terms_(program.terms),
          initial_(terms_.size() + program.formulas.size()),
          streams_(initial_.size()) {}

    void build() {
        for (const std::size_t r : program_.streams)
            machine_.workspace_.unknowns.count += r >= terms_.size() && unsettled(formula(r));
        if (machine_.workspace_.unknowns.count > kMaxUnknowns) refuse("too many unknowns");
        for (const std::size_t r : program_.streams) {
            machine_.streams_.push_back(r < terms_.size() ? leaf(r) : stream(formula(r)));
            streams_.at(r) = machine_.streams_.back().get();
        }
        for (const std::size_t r : program_.initial) {
            machine_.initial_.push_back(r < terms_.size() ? term(r) : initial_value(formula(r)));
            initial_.at(r) = machine_.initial_.back().get();
        }
        if (program_.initial.empty()) refuse("expected a result, got none");
    }

private:
    const FormulaRow& formula(std::size_t r) const { return program_.formula(r); }
    static bool unsettled(const FormulaRow& f) { return f.kind == "WINDOW" && !f.hi; }
    static bool maps(const FormulaRow& f) {
        if (f.kind != "MAP" && f.kind != "WINDOW") refuse("unknown kind '" + f.kind + "'");
        return f.kind == "MAP";
    }
    template <class T>
    static T& made(const std::vector<T*>& all, std::size_t r) {
        if (r >= all.size() || all[r] == nullptr)
            refuse("register " + std::to_string(r) + " is read before it is written");
        return *all[r];
    }

    std::unique_ptr<Stream> leaf(std::size_t r) {
        if (terms_[r].kind == "CONST")
            return std::make_unique<Constant>(machine_.workspace_, terms_[r].value);
        return std::make_unique<Predicate>(machine_.workspace_, r);
    }

    std::unique_ptr<Stream> stream(const FormulaRow& f) {
        Workspace& workspace = machine_.workspace_;
        Stream& a = made(streams_, f.a);
        Stream& b = made(streams_, f.b);
        if (maps(f)) return of_choice<PointwiseStream, Stream>(f.name, workspace, a, b);
        if (unsettled(f)) {
            auto future = of_fold<UnboundedFutureStream, UnsettledStream>(
                f.name, workspace, a, b, machine_.unsettled_.size());
            machine_.unsettled_.push_back(future.get());
            return future;
        }
        if (!f.lo) return of_fold<UnboundedPastStream, Stream>(f.name, workspace, a, b, *f.hi);
        return of_fold<SlidingStream, Stream>(f.name, workspace, a, b, *f.lo, *f.hi, role_of(f));
    }

    std::unique_ptr<InitialValue> term(std::size_t r) {
        const DiscreteRow& row = terms_[r];
        return std::make_unique<InitialTerm>(
            r, row.kind == "CONST" ? std::optional<double>(row.value) : std::nullopt);
    }

    std::unique_ptr<InitialValue> initial_value(const FormulaRow& f) {
        if (maps(f))
            return of_choice<InitialMap, InitialValue>(f.name, made(initial_, f.a),
                                                       made(initial_, f.b));
        return of_fold<InitialFold, InitialValue>(f.name, machine_.workspace_, made(streams_, f.a),
                                                  made(streams_, f.b), f.lo.value_or(0),
                                                  f.hi.value_or(kNever), role_of(f));
    }

    EpisodeMachine& machine_;
    const Program& program_;
    const std::vector<DiscreteRow>& terms_;
    std::vector<InitialValue*> initial_;
    std::vector<Stream*> streams_;
};

EpisodeMachine::EpisodeMachine(const Program& program)
    : terms_(program.terms, program.variables),
      fingerprint_(fingerprint_of(terms_.fingerprint(), program.formulas)) {
    Builder(*this, program).build();
    for (const auto& value : initial_) value->demand();
    propagate_demands();
    for (const auto& stream : streams_) stream->prepare();
    for (const auto& value : initial_) value->prepare();
    reset();
    for (const OpenTask& task : open_tasks_) task.stream->find_open(task.world, -1);
    find_values(-1, terms_.registers().data());
    empty_ = values_;
    empty_[kNow] = std::nan("");
    reset();
}

EpisodeMachine::~EpisodeMachine() = default;

// Passes demands on from the result to the terms. Readers of settled values need their unknowns.
void EpisodeMachine::propagate_demands() {
    const auto want_unknowns = [this](std::uint32_t mask, World w) {
        for (std::size_t k = 0; k < unsettled_.size(); ++k)
            if (mask >> k & 1) unsettled_[k]->want(w);
    };
    for (const auto& value : initial_)
        for (std::size_t w = 0; w < kWorlds; ++w)
            if (value->wants(World(w))) want_unknowns(value->unknown_mask(), World(w));
    for (std::size_t i = streams_.size(); i-- > 0;) {
        Stream& stream = *streams_[i];
        for (std::size_t w = 0; w < kWorlds; ++w)
            if (stream.wanted(World(w))) want_unknowns(stream.unknown_mask(), World(w));
        stream.propagate_demands();
    }
}

void EpisodeMachine::plan(Time t) {
    for (const auto& stream : streams_) stream->clear_demands();
    next_plan_ = kNever;
    open_ = false;
    for (const auto& value : initial_) {
        next_plan_ = std::min(next_plan_, value->demand(t));
        open_ |= value->open(t - 1);
    }
    if (t <= 0) {  // before the first sample there is no robustness, whatever else is certain
        open_ = true;
        next_plan_ = std::min<Time>(next_plan_, 1);
    }
    propagate_demands();
    settle_tasks_.clear();
    open_tasks_.clear();
    for (const auto& stream : streams_) {
        if (!stream->active()) continue;
        settle_tasks_.push_back({stream.get(), nullptr});
        for (World w : kAll)
            if (stream->finds_open(w)) open_tasks_.push_back({stream.get(), w});
    }
    for (UnsettledStream* unsettled : unsettled_)
        for (SettleTask& task : settle_tasks_)
            if (task.stream == unsettled) task.unsettled = unsettled;
}

bool EpisodeMachine::take() {
    if (!terms_.take()) return false;
    advance();
    return true;
}

void EpisodeMachine::take(const double* inputs, const double* terms, std::size_t stride) {
    terms_.take(inputs, terms, stride);
    advance();
}

void EpisodeMachine::advance() {
    const Time t = terms_.samples() - 1;
    if (t >= next_plan_) plan(t);
    if (open_) {
        const double* terms = terms_.registers().data();
        settle(t, terms);
        for (const OpenTask& task : open_tasks_) task.stream->find_open(task.world, t);
        find_values(t, terms);
    }
}

void EpisodeMachine::settle(Time t, const double* terms) {
    for (const SettleTask& task : settle_tasks_) {
        task.stream->settle(t, terms);
        UnsettledStream* unsettled = task.unsettled;
        if (unsettled == nullptr || !unsettled->has_settled()) continue;
        const std::size_t unknown = unsettled->unknown();
        for (const SettleTask& other : settle_tasks_)
            if (other.stream->unknown_mask() >> unknown & 1)
                other.stream->substitute(unknown, unsettled->value());
        for (const auto& value : initial_) value->substitute(unknown, unsettled->value());
        unsettled->append();
    }
}

void EpisodeMachine::find_values(Time t, const double* terms) {
    for (const auto& value : initial_) value->advance(t, terms);
    for (World w : kAll) values_[w] = initial_.back()->value(w);
}

void EpisodeMachine::finish(End end) {
    if (finished_) return;
    switch (end) {
        case End::complete:
            values_[kLower] = values_[kUpper] = values_[kNow];
            break;
        case End::cut:
            cut();
            break;
        case End::open:
            break;
    }
    finished_ = true;
}

void EpisodeMachine::cut() {
    const Time t = terms_.samples() - 1;
    for (const auto& stream : streams_)
        for (World w : kAtEnd)
            if (stream->finds_open(w)) stream->find_open(w, t);
    for (const auto& value : initial_) value->cut(t);
    values_[kLower] = initial_.back()->value(kCutLower);
    values_[kUpper] = initial_.back()->value(kCutUpper);
    values_[kNow] = moved(values_[kNow], lower(), upper());
}

void EpisodeMachine::reset() {
    terms_.reset();
    for (const auto& stream : streams_) stream->reset();
    for (const auto& value : initial_) value->reset();
    values_ = empty_;
    finished_ = false;
    plan(-1);
}

void EpisodeMachine::fields(Snapshot& s) {
    terms_.fields(s);
    s(finished_, values_);
    const Time t = terms_.samples() - 1;
    if (s.reads()) plan(t);
    for (const auto& stream : streams_)
        if (stream->active()) stream->fields(s, t);
    for (const auto& value : initial_) value->fields(s);
}

}  // namespace rtamt
