// DiscreteMachine::run: one instruction at a time, over blocks of samples that stay in the cache.
#include <algorithm>
#include <cmath>

#include "discrete/columns.hpp"

namespace rtamt {
namespace {

constexpr std::size_t kBlockSize = 256;

}  // namespace

// The values of all registers at the samples t to t + count - 1.
class DiscreteMachine::Block : public RegisterColumns {
public:
    Block(DiscreteMachine& machine, std::size_t size)
        : RegisterColumns(machine, size), machine_(machine) {}

    void formulas(std::int64_t t, std::size_t count) {
        for (const Instruction& i : machine_.formulas_)
            dispatch(
                i.opcode, [&]<double (*function)(double, double)> { map(i, count); },
                [&]<class Window> { push<Window>(i, t, count); },
                [&] { static_cast<DelayLine*>(i.memory)->push(at(i.a), out(i.out), count); });
    }

private:
    template <class Window>
    void push(const Instruction& i, std::int64_t t, std::size_t count) {
        using F = typename Window::Fold;
        double* out = this->out(i.out);
        auto* window = static_cast<Window*>(i.memory);
        const auto begin = static_cast<std::size_t>(
            std::clamp<std::int64_t>(i.start - t, 0, static_cast<std::int64_t>(count)));
        for (std::size_t k = 0; k < begin; ++k) out[k] = F::result(window->push(F::identity));
        if (begin < count)
            window->push(at(i.a) + begin, at(i.b) + begin, out + begin, count - begin);
    }

    DiscreteMachine& machine_;
};

std::size_t DiscreteMachine::run(const double* const* columns, std::size_t n,
                                 double* const* outputs) {
    if (n == 0) return 0;
    Block block(*this, std::min(n, kBlockSize));
    if (const std::size_t bad = block.first_refused(columns, n); bad < n) return bad;
    std::size_t count = 0;
    for (std::size_t from = 0; from < n; from += count) {
        count = std::min(kBlockSize, n - from);
        // Another thread may have written to the columns since they were looked through.
        if (const std::size_t bad = block.terms(columns, from, count); bad < count)
            return from + bad;
        block.formulas(samples_, count);
        for (std::size_t i = 1; i < observed_.size(); ++i) {
            const double* values = block.at(observed_[i].slot);
            // The samples of this block before the first value.
            const auto early = static_cast<std::size_t>(std::clamp<std::int64_t>(
                observed_[i].latency - samples_, 0, static_cast<std::int64_t>(count)));
            double* output = outputs[i - 1] + from;
            std::fill_n(output, early, std::nan(""));
            std::copy_n(values + early, count - early, output + early);
        }
        samples_ += static_cast<std::int64_t>(count);
    }
    for (std::size_t v = 0; v < variables_; ++v) inputs_[v] = columns[v][n - 1];
    for (std::size_t slot = 0; slot < registers_.size(); ++slot)
        registers_[slot] = block.at(slot)[count - 1];
    return n;
}

}  // namespace rtamt
