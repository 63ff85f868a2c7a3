// DiscreteMachine::run: an instruction at a time, over blocks of samples that stay in the cache.
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/columns.hpp"
#include "discrete/machine.hpp"

namespace rtamt {
namespace {

constexpr std::size_t kMost = 256;  // samples in a block
constexpr std::int64_t kForever = std::numeric_limits<std::int64_t>::max() / 2;

}  // namespace

// The values of all registers at the samples t to t + count - 1.
class DiscreteMachine::Block {
public:
    Block(DiscreteMachine& machine, std::size_t size)
        : machine_(machine),
          size_(size),
          lanes_(std::make_unique_for_overwrite<double[]>(machine.registers_.size() * size)),
          at_(machine.registers_.size()) {
        for (std::size_t slot = 0; slot < at_.size(); ++slot) {
            std::fill_n(lane(slot), size, machine.initial_[slot]);
            at_[slot] = lane(slot);
        }
    }

    const double* at(std::size_t slot) const { return at_[slot]; }

    // Evaluates the terms; the place of the first sample with a nan, or count.
    std::size_t terms(const double* const* columns, std::size_t from, std::size_t count) {
        for (const Load& load : machine_.loads_) at_[load.out] = columns[load.variable] + from;
        return checked_terms(count);
    }

    // The same once more, with the variables as they were last.
    void last_terms(std::size_t count) {
        for (const Load& load : machine_.loads_) {
            std::fill_n(lane(load.out), size_, machine_.inputs_[load.variable]);
            at_[load.out] = lane(load.out);
        }
        checked_terms(count);
    }

    // Evaluates the formulas; the trace has the times 0 <= time < end.
    void formulas(std::int64_t t, std::size_t count, std::int64_t end) {
        for (const Step& step : machine_.formulas_) execute(step, t, count, end);
    }

private:
    double* lane(std::size_t slot) { return lanes_.get() + slot * size_; }

    std::size_t checked_terms(std::size_t count) {
        for (const Step& step : machine_.terms_) execute(step, 0, count, kForever);
        std::size_t first = count;
        for (const Load& load : machine_.loads_) first = columns::first_nan(at_[load.out], first);
        for (const Step& step : machine_.terms_) first = columns::first_nan(at_[step.out], first);
        return first;
    }

    void execute(const Step& step, std::int64_t t, std::size_t count, std::int64_t end) {
        const double* a = at_[step.a];
        const double* b = at_[step.b];
        double* out = lane(step.out);
        switch (step.opcode) {
#define RTAMT_CASE(name, arity, value)   \
    case Opcode::map_##name:             \
        columns::map_##name(a, b, out, count); \
        break;
            RTAMT_FUNCTIONS(RTAMT_CASE)
#undef RTAMT_CASE
#define RTAMT_CASE(name, Type)                                   \
    case Opcode::latest_##name:                                  \
        push<Latest<Type>>(step, a, b, out, t, count, end);      \
        break;                                                   \
    case Opcode::running_##name:                                 \
        push<Running<Type>>(step, a, b, out, t, count, end);     \
        break;                                                   \
    case Opcode::sliding_##name:                                 \
        push<Sliding<Type>>(step, a, b, out, t, count, end);     \
        break;
            RTAMT_FOLDS(RTAMT_CASE)
#undef RTAMT_CASE
            case Opcode::delay:
                static_cast<Delay*>(step.part)->push(a, out, count);
                break;
        }
    }

    template <class Fold>
    static void push(const Step& step, const double* a, const double* b, double* out,
                     std::int64_t t, std::size_t count, std::int64_t end) {
        using M = typename Fold::Monoid;
        auto* fold = static_cast<Fold*>(step.part);
        const auto place = [&](std::int64_t sample) {
            return std::clamp<std::int64_t>(sample - t, 0, static_cast<std::int64_t>(count));
        };
        const auto identities = [&](std::size_t from, std::size_t to) {
            for (; from < to; ++from) out[from] = M::result(fold->push(M::identity));
        };
        const std::size_t begin = place(step.start);
        const std::size_t stop = place(step.start + end);
        identities(0, begin);
        if (stop > begin) fold->push(a + begin, b + begin, out + begin, stop - begin);
        identities(std::max(begin, stop), count);
    }

    DiscreteMachine& machine_;
    std::size_t size_;
    std::unique_ptr<double[]> lanes_;
    std::vector<const double*> at_;
};

std::size_t DiscreteMachine::run(const double* const* columns, std::size_t n, bool final,
                         double* const* outputs) {
    if (n == 0) return 0;
    std::int64_t longest = 0;
    for (std::size_t i = 1; i < observed_.size(); ++i)
        longest = std::max(longest, observed_[i].latency);
    const std::size_t more = final ? static_cast<std::size_t>(longest) : 0;
    Block block(*this, std::min(n + more, kMost));

    // All or none. A trace that ends has no state to keep: there the check on the way is enough.
    if (!final && n > kMost) {
        for (std::size_t from = 0; from < n; from += kMost) {
            const std::size_t count = std::min(kMost, n - from);
            const std::size_t bad = block.terms(columns, from, count);
            if (bad < count) return from + bad;
        }
    }
    std::size_t count = 0;
    for (std::size_t from = 0; from < n + more; from += count) {
        const bool ended = from >= n;
        count = std::min(kMost, (ended ? n + more : n) - from);
        if (ended) {
            block.last_terms(count);
        } else {
            const std::size_t bad = block.terms(columns, from, count);
            if (bad < count) return from + bad;
        }
        block.formulas(samples_, count, ended ? static_cast<std::int64_t>(n) : kForever);
        for (std::size_t i = 1; i < observed_.size(); ++i) {
            const double* values = block.at(observed_[i].slot);
            // Samples of this block that come before the first value.
            const auto early = static_cast<std::size_t>(std::clamp<std::int64_t>(
                observed_[i].latency - samples_, 0, static_cast<std::int64_t>(count)));
            double* output = outputs[i - 1];
            if (!final) {
                std::fill_n(output + from, early, std::nan(""));
                std::copy_n(values + early, count - early, output + from + early);
            } else {
                const std::size_t time =
                    from + early - static_cast<std::size_t>(observed_[i].latency);
                if (early < count && time < n)
                    std::copy_n(values + early, std::min(count - early, n - time), output + time);
            }
        }
        samples_ += static_cast<std::int64_t>(count);
        if (from + count == n)
            for (std::size_t v = 0; v < variables_; ++v) inputs_[v] = columns[v][n - 1];
    }
    for (std::size_t slot = 0; slot < registers_.size(); ++slot)
        registers_[slot] = block.at(slot)[count - 1];
    return n;
}

}  // namespace rtamt
