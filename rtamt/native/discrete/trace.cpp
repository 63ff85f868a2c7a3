// DiscreteMachine::evaluate: one instruction at a time, over blocks that stay in the cache.
#include "discrete/trace.hpp"

#include <type_traits>

#include "discrete/columns.hpp"

namespace rtamt {
namespace {

constexpr std::size_t kBlockSize = 4096;  // far more than most windows reach back
constexpr std::size_t kDoubled = 2048;    // longer windows are pushed

// What an instruction remembers between the blocks; nothing if it is a function.
std::unique_ptr<trace::Memory> memory_of(const Instruction& instruction, std::size_t most) {
    std::unique_ptr<trace::Memory> made;
    dispatch(
        instruction.opcode, []<double (*function)(double, double)> {},
        [&]<class Window> {
            using F = typename Window::Fold;
            if constexpr (std::is_same_v<Window, SlidingWindow<F>>) {
                const std::size_t length = static_cast<const Window*>(instruction.memory)->length();
                if (length <= kDoubled)
                    made = std::make_unique<trace::Doubled<F>>(length, most);
                else
                    made = std::make_unique<trace::Pushed<Window>>(length);
            } else if constexpr (std::is_same_v<Window, RunningWindow<F>> && F::width == 1) {
                made = std::make_unique<trace::Extreme<F>>();
            } else {
                made = std::make_unique<trace::Pushed<Window>>();
            }
        },
        [&] {
            const auto* line = static_cast<const DelayLine*>(instruction.memory);
            made = std::make_unique<trace::Delayed>(line->length());
        });
    return made;
}

}  // namespace

// The registers at consecutive times of a trace of n samples.
class DiscreteMachine::Trace {
public:
    Trace(const DiscreteMachine& machine, const double* const* columns, std::size_t n,
          bool backwards, std::size_t most)
        : machine_(machine), registers_(machine, most), columns_(columns), n_(n),
          backwards_(backwards) {
        for (const Instruction& i : machine.formulas_) memories_.push_back(memory_of(i, most));
    }

    const double* at(std::size_t slot) const { return registers_.at(slot); }

    // Evaluates the terms at the times from `time` on. Returns false if one is nan.
    bool terms(std::size_t time, std::size_t count) {
        const std::size_t from = place(time, count);
        if (!backwards_) return registers_.terms(columns_, from, count) == count;
        for (const Load& load : machine_.loads_)
            columns::reverse(columns_[load.variable] + from, registers_.out(load.out), count);
        return registers_.first_unread(columns_, from, count) == count &&
               registers_.terms(count) == count;
    }
    // Behind the trace the registers of terms keep some values, which no window takes in.
    void end() {
        for (const Load& load : machine_.loads_) registers_.point(load.out, registers_.out(load.out));
    }
    // The first sample with a nan, after `terms` saw one at these times. Another thread may have
    // written over it since then: if none is found, the first sample of these times.
    std::size_t first_refused(std::size_t time, std::size_t count) {
        const std::size_t found = registers_.first_refused(columns_, n_);
        return found < n_ ? found : place(time, count);
    }

    void formulas(std::size_t time, std::size_t count) {
        auto memory = memories_.begin();
        for (const Instruction& i : machine_.formulas_) {
            if (*memory == nullptr) {
                registers_.map(i, count);
            } else {
                const auto inside = [&](std::int64_t t) {
                    t -= static_cast<std::int64_t>(time);
                    return static_cast<std::size_t>(
                        std::clamp<std::int64_t>(t, 0, static_cast<std::int64_t>(count)));
                };
                (*memory)->push({at(i.a), at(i.b), count, inside(i.start),
                                 inside(i.start + static_cast<std::int64_t>(n_))},
                                registers_.out(i.out));
            }
            ++memory;
        }
    }

    // The place in the trace of the times from `time` on.
    std::size_t place(std::size_t time, std::size_t count) const {
        return backwards_ ? n_ - time - count : time;
    }

    // Has formulas write their values of the times from `time` on to an output at once.
    void aim(std::size_t slot, double* output) {
        const auto writes = [slot](const Instruction& i) { return i.out == slot; };
        const auto& formulas = machine_.formulas_;
        if (std::any_of(formulas.begin(), formulas.end(), writes)) registers_.write_to(slot, output);
    }

    // Writes values of the times from `time` on, if they are not there.
    void write(const double* values, std::size_t time, std::size_t count, double* output) const {
        if (backwards_) {
            columns::reverse(values, output + place(time, count), count);
        } else if (values != output + time) {
            std::copy_n(values, count, output + time);
        }
    }

private:
    const DiscreteMachine& machine_;
    RegisterColumns registers_;
    const double* const* columns_;
    std::size_t n_;
    bool backwards_;
    std::vector<std::unique_ptr<trace::Memory>> memories_;
};

std::size_t DiscreteMachine::evaluate(const double* const* columns, std::size_t n, bool backwards,
                                      double* const* outputs) const {
    std::size_t longest = 0;
    for (std::size_t i = 1; i < observed_.size(); ++i)
        longest = std::max(longest, static_cast<std::size_t>(observed_[i].latency));
    Trace trace(*this, columns, n, backwards, std::min(n + longest, kBlockSize));
    for (std::size_t time = 0, count = 0; time < n + longest; time += count) {
        count = std::min(kBlockSize, (time < n ? n : n + longest) - time);
        if (time >= n) {
            trace.end();
        } else if (!trace.terms(time, count)) {
            return trace.first_refused(time, count);
        }
        for (std::size_t i = 1; i < observed_.size() && !backwards; ++i) {
            const auto late = static_cast<std::size_t>(observed_[i].latency);
            const bool inside = time >= late && time + count <= n + late;
            trace.aim(observed_[i].slot, inside ? outputs[i - 1] + (time - late) : nullptr);
        }
        trace.formulas(time, count);
        for (std::size_t i = 1; i < observed_.size(); ++i) {
            // The values of this block that belong to times of the trace.
            const auto late = static_cast<std::size_t>(observed_[i].latency);
            const std::size_t first = std::max(time, late);
            const std::size_t end = std::min(time + count, n + late);
            if (first < end)
                trace.write(trace.at(observed_[i].slot) + (first - time), first - late,
                            end - first, outputs[i - 1]);
        }
    }
    return n;
}

}  // namespace rtamt
