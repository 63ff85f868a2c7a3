// DiscreteMachine::run: one instruction at a time, over blocks of samples that stay in the cache.
#include <algorithm>
#include <cmath>
#include <limits>

#include "discrete/columns.hpp"

namespace rtamt {
namespace {

constexpr std::size_t kBlockSize = 256;
constexpr std::int64_t kForever = std::numeric_limits<std::int64_t>::max() / 2;

}  // namespace

// The values of all registers at the samples t to t + count - 1.
class DiscreteMachine::Block : public RegisterColumns {
public:
    Block(DiscreteMachine& machine, std::size_t size)
        : RegisterColumns(machine, size), machine_(machine) {}

    // Evaluates the terms. Returns the index of the first sample with a nan, or count.
    std::size_t terms(const double* const* columns, std::size_t from, std::size_t count) {
        for (const Load& load : machine_.loads_) point(load.out, columns[load.variable] + from);
        return RegisterColumns::terms(count);
    }

    // Evaluates the terms again, of the last sample.
    void last_terms(std::size_t count) {
        for (const Load& load : machine_.loads_) {
            std::fill_n(out(load.out), size(), machine_.inputs_[load.variable]);
            point(load.out, out(load.out));
        }
        RegisterColumns::terms(count);
    }

    // Evaluates the formulas; the trace has the times 0 <= time < end.
    void formulas(std::int64_t t, std::size_t count, std::int64_t end) {
        for (const Instruction& i : machine_.formulas_)
            dispatch(
                i.opcode, [&]<double (*function)(double, double)> { map(i, count); },
                [&]<class Window> { push<Window>(i, t, count, end); },
                [&] { static_cast<DelayLine*>(i.memory)->push(at(i.a), out(i.out), count); });
    }

private:
    template <class Window>
    void push(const Instruction& i, std::int64_t t, std::size_t count, std::int64_t end) {
        using F = typename Window::Fold;
        const double* a = at(i.a);
        const double* b = at(i.b);
        double* out = this->out(i.out);
        auto* window = static_cast<Window*>(i.memory);
        const auto place = [&](std::int64_t sample) {
            return std::clamp<std::int64_t>(sample - t, 0, static_cast<std::int64_t>(count));
        };
        const auto identities = [&](std::size_t from, std::size_t to) {
            for (; from < to; ++from) out[from] = F::result(window->push(F::identity));
        };
        const std::size_t begin = place(i.start);
        const std::size_t stop = place(i.start + end);
        identities(0, begin);
        if (stop > begin) window->push(a + begin, b + begin, out + begin, stop - begin);
        identities(std::max(begin, stop), count);
    }

    DiscreteMachine& machine_;
};

std::size_t DiscreteMachine::run(const double* const* columns, std::size_t n, bool final,
                         double* const* outputs) {
    if (n == 0) return 0;
    std::int64_t longest = 0;
    for (std::size_t i = 1; i < observed_.size(); ++i)
        longest = std::max(longest, observed_[i].latency);
    const std::size_t more = final ? static_cast<std::size_t>(longest) : 0;
    Block block(*this, std::min(n + more, kBlockSize));

    // All samples or none. A final trace leaves no state behind: the check on the way is enough.
    if (!final && n > kBlockSize) {
        for (std::size_t from = 0; from < n; from += kBlockSize) {
            const std::size_t count = std::min(kBlockSize, n - from);
            const std::size_t bad = block.terms(columns, from, count);
            if (bad < count) return from + bad;
        }
    }
    std::size_t count = 0;
    for (std::size_t from = 0; from < n + more; from += count) {
        const bool ended = from >= n;
        count = std::min(kBlockSize, (ended ? n + more : n) - from);
        if (ended) {
            block.last_terms(count);
        } else {
            const std::size_t bad = block.terms(columns, from, count);
            if (bad < count) return from + bad;
        }
        block.formulas(samples_, count, ended ? static_cast<std::int64_t>(n) : kForever);
        for (std::size_t i = 1; i < observed_.size(); ++i) {
            const double* values = block.at(observed_[i].slot);
            // The samples of this block before the first value.
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
