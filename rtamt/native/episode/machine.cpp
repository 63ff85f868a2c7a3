#include "episode/machine.hpp"

#include <cmath>
#include <stdexcept>
#include <utility>

#include "episode/sliding.hpp"
#include "episode/top.hpp"
#include "episode/unbounded.hpp"

namespace rtamt {

using namespace episode;

namespace {

[[noreturn]] void refuse(const std::string& what) { throw std::invalid_argument(what); }

// An object of a class over a fold that is known by name.
template <template <class> class Class, class Base, class... Args>
std::unique_ptr<Base> of_fold(const std::string& name, Args&&... args) {
#define RTAMT_NAMED(name_, Type) \
    if (name == #name_) return std::make_unique<Class<Type>>(std::forward<Args>(args)...);
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

std::uint64_t fingerprint_of(std::uint64_t terms, const std::vector<Formula>& formulas) {
    Fingerprint print;
    print.add(terms);
    for (const Formula& formula : formulas) {
        print.add(formula.kind);
        print.add(formula.name);
        print.add(formula.a);
        print.add(formula.b);
        print.add(formula.lo);
        print.add(formula.hi);
    }
    return print.value();
}

}  // namespace

class EpisodeMachine::Builder {
public:
    Builder(EpisodeMachine& machine, const std::vector<Row>& terms,
            const std::vector<Formula>& formulas)
        : machine_(machine),
          terms_(terms),
          formulas_(formulas),
          tops_(terms.size() + formulas.size()),
          streams_(tops_.size()) {}

    void build(const std::vector<std::size_t>& tops, const std::vector<std::size_t>& streams) {
        for (const std::size_t r : streams)
            machine_.desk_.unknowns.count += r >= terms_.size() && endless(formula(r));
        if (machine_.desk_.unknowns.count > kMaxUnknowns) refuse("too many unknowns");
        for (const std::size_t r : streams) {
            machine_.streams_.push_back(r < terms_.size() ? leaf(r) : stream(formula(r)));
            streams_.at(r) = machine_.streams_.back().get();
        }
        for (const std::size_t r : tops) {
            machine_.tops_.push_back(r < terms_.size() ? term(r) : top(formula(r)));
            tops_.at(r) = machine_.tops_.back().get();
        }
        if (tops.empty()) refuse("expected a result, got none");
    }

private:
    const Formula& formula(std::size_t r) const { return formulas_.at(r - terms_.size()); }
    static bool endless(const Formula& f) { return f.kind == "WINDOW" && f.hi == kNever; }
    static bool maps(const Formula& f) {
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
            return std::make_unique<Constant>(machine_.desk_, terms_[r].value);
        return std::make_unique<Predicate>(machine_.desk_, r);
    }

    std::unique_ptr<Stream> stream(const Formula& f) {
        Desk& desk = machine_.desk_;
        Stream& a = made(streams_, f.a);
        Stream& b = made(streams_, f.b);
        if (maps(f)) return of_choice<PointwiseStream, Stream>(f.name, desk, a, b);
        if (endless(f)) {
            auto endless = of_fold<EndlessStream, Endless>(f.name, desk,
                                                             machine_.unknowns_.size(), a, b);
            machine_.unknowns_.push_back(endless.get());
            return endless;
        }
        if (f.lo == -kNever) return of_fold<RunningStream, Stream>(f.name, desk, f.hi, a, b);
        return of_fold<SlidingStream, Stream>(f.name, desk, f.lo, f.hi, a, b);
    }

    std::unique_ptr<Top> term(std::size_t r) {
        const Row& row = terms_[r];
        return std::make_unique<TopTerm>(
            r, row.kind == "CONST" ? std::optional<double>(row.value) : std::nullopt);
    }

    std::unique_ptr<Top> top(const Formula& f) {
        if (maps(f)) return of_choice<TopMap, Top>(f.name, made(tops_, f.a), made(tops_, f.b));
        return of_fold<TopFold, Top>(f.name, machine_.desk_, f.lo, f.hi, made(streams_, f.a),
                                       made(streams_, f.b));
    }

    EpisodeMachine& machine_;
    const std::vector<Row>& terms_;
    const std::vector<Formula>& formulas_;
    std::vector<Top*> tops_;
    std::vector<Stream*> streams_;
};

EpisodeMachine::EpisodeMachine(const std::vector<Row>& terms, std::size_t variables,
                               const std::vector<Formula>& formulas,
                               const std::vector<std::size_t>& tops,
                               const std::vector<std::size_t>& streams)
    : terms_(terms, terms.size(), variables, {{terms.empty() ? 0 : terms.size() - 1, 0}}),
      fingerprint_(fingerprint_of(terms_.mark(), formulas)) {
    Builder(*this, terms, formulas).build(tops, streams);
    for (const auto& stream : streams_) stream->neglect();
    for (const auto& top : tops_) top->demand();
    demand();
    for (const auto& stream : streams_) stream->prepare();
    for (const auto& top : tops_) top->prepare();
    reset();
    for (const Look& look : looks_) look.stream->look(look.world, -1);
    conclude(-1, terms_.registers().data());
    empty_ = values_;
    empty_[kNow] = std::nan("");
    reset();
}

EpisodeMachine::~EpisodeMachine() = default;

// Hands down what the tops want; who reads settled values reads unknowns.
void EpisodeMachine::demand() {
    const auto wants_unknowns = [this](std::uint32_t speaks_of, World w) {
        for (std::size_t k = 0; k < unknowns_.size(); ++k)
            if (speaks_of >> k & 1) unknowns_[k]->want(w);
    };
    for (const auto& top : tops_)
        for (World w : kAll)
            if (top->wants(w)) wants_unknowns(top->speaks_of(), w);
    for (std::size_t i = streams_.size(); i-- > 0;) {
        Stream& stream = *streams_[i];
        for (World w : kAll)
            if (stream.wanted(w)) wants_unknowns(stream.speaks_of(), w);
        stream.demand();
    }
}

void EpisodeMachine::plan(Time t) {
    for (const auto& stream : streams_) stream->neglect();
    next_plan_ = kNever;
    open_ = false;
    for (const auto& top : tops_) {
        next_plan_ = std::min(next_plan_, top->demand(t));
        open_ |= top->open(t - 1);
    }
    if (t <= 0) {  // before the first sample there is no robustness, whatever else is certain
        open_ = true;
        next_plan_ = std::min<Time>(next_plan_, 1);
    }
    demand();
    settles_.clear();
    looks_.clear();
    for (const auto& stream : streams_) {
        if (!stream->alive()) continue;
        settles_.push_back({stream.get(), nullptr});
        for (World w : kAll)
            if (stream->looks(w)) looks_.push_back({stream.get(), w});
    }
    for (Endless* unknown : unknowns_)
        for (Settle& settle : settles_)
            if (settle.stream == unknown) settle.endless = unknown;
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
        for (const Look& look : looks_) look.stream->look(look.world, t);
        conclude(t, terms);
    }
}

void EpisodeMachine::settle(Time t, const double* terms) {
    for (const Settle& settle : settles_) {
        settle.stream->settle(t, terms);
        Endless* endless = settle.endless;
        if (endless == nullptr || !endless->has_settled()) continue;
        for (const Settle& other : settles_)
            if (other.stream->speaks_of() >> endless->unknown() & 1)
                other.stream->substitute(endless->unknown(), endless->value());
        for (const auto& top : tops_) top->substitute(endless->unknown(), endless->value());
        endless->append();
    }
}

void EpisodeMachine::conclude(Time t, const double* terms) {
    for (const auto& top : tops_) top->advance(t, terms);
    for (World w : kAll) values_[w] = tops_.back()->value(w);
}

void EpisodeMachine::finish() {
    finished_ = true;
    if (lower() <= 0.0 && upper() >= 0.0) values_[kLower] = values_[kUpper] = values_[kNow];
}

void EpisodeMachine::reset() {
    terms_.reset();
    for (const auto& stream : streams_) stream->reset();
    for (const auto& top : tops_) top->reset();
    values_ = empty_;
    finished_ = false;
    plan(-1);
}

std::string EpisodeMachine::state() const {
    Writer out;
    out.put(fingerprint_);
    const std::string terms = terms_.state();
    out.put<std::uint64_t>(terms.size());
    out.put(terms.data(), terms.size());
    out.put<std::uint64_t>(finished_);
    out.put(values_);
    for (const auto& stream : streams_)
        if (stream->alive()) stream->save(out);
    for (const auto& top : tops_) top->save(out);
    return out.bytes();
}

void EpisodeMachine::restore(std::string_view bytes) {
    Reader in(bytes);
    if (bytes.size() < sizeof fingerprint_ || in.get<std::uint64_t>() != fingerprint_)
        refuse(DiscreteMachine::kForeign);
    try {
        reset();
        terms_.restore(in.bytes(in.get<std::uint64_t>()));
        finished_ = in.get<std::uint64_t>() != 0;
        values_ = in.get<decltype(values_)>();
        const Time t = terms_.samples() - 1;
        plan(t);
        for (const auto& stream : streams_)
            if (stream->alive()) stream->load(in, t);
        for (const auto& top : tops_) top->load(in);
        Reader::require(in.empty());
    } catch (const std::invalid_argument&) {
        reset();
        throw;
    }
}

}  // namespace rtamt
