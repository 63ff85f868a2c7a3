// DiscreteMachine::run and evaluate: one instruction at a time, over blocks that stay in the cache.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <memory>
#include <type_traits>
#include <vector>

#include "core/arrays.hpp"
#include "core/columns.hpp"
#include "core/windows.hpp"
#include "discrete/columns.hpp"

namespace rtamt::trace {

// Folds of windows over a whole trace, block after block. As nothing is waited for, a block costs
// what its loops cost; the windows of monitors bound each single push instead.

// Two columns of operands, or one to which both pointers point, at n times; those outside of begin
// and end are outside of the trace.
struct Operands {
    const double* a;
    const double* b;
    std::size_t n;
    std::size_t begin;
    std::size_t end;
};

// The memory of one instruction.
class Memory {
public:
    Memory() = default;
    Memory(const Memory&) = delete;
    Memory& operator=(const Memory&) = delete;
    virtual ~Memory() = default;

    virtual void push(const Operands& in, double* out) = 0;
};

// A fold that the windows of monitors do as fast: it pushes the operands into one of those.
template <class Window>
class Pushed final : public Memory {
public:
    using F = typename Window::Fold;

    template <class... Args>
    explicit Pushed(Args... args) : window_(args...) {}

    void push(const Operands& in, double* out) override {
        identities(out, 0, in.begin);
        if (in.end > in.begin)
            window_.push(in.a + in.begin, in.b + in.begin, out + in.begin, in.end - in.begin);
        identities(out, std::max(in.begin, in.end), in.n);
    }

private:
    void identities(double* out, std::size_t from, std::size_t to) {
        for (; from < to; ++from) out[from] = F::result(window_.push(F::identity));
    }

    Window window_;
};

class Delayed final : public Memory {
public:
    explicit Delayed(std::size_t length) : line_(length) {}
    void push(const Operands& in, double* out) override { line_.push(in.a, out, in.n); }

private:
    DelayLine line_;
};

// The least, or greatest, element so far. A new one is rare: most chunks are compared and filled.
template <class F>
class Extreme final : public Memory {
public:
    void push(const Operands& in, double* out) override {
        std::fill_n(out, in.begin, total_);
        std::size_t at = in.begin;
        while (at < in.end) {
            const std::size_t count = std::min(kChunk, in.end - at);
            const double* x = in.a + at;
            const double total = fold<F>(total_, {x, x}, count);
            if (same(total, total_)) {
                std::fill_n(out + at, count, total_);
            } else {
                for (std::size_t i = 0; i < count; ++i)
                    out[at + i] = total_ = F::combine_alone(total_, x[i]);
            }
            at += count;
        }
        std::fill_n(out + at, in.n - at, total_);
    }

private:
    static constexpr std::size_t kChunk = 64;

    double total_ = F::identity;
};

template <class F>
RTAMT_LOOP void combine(const double* __restrict xp, const double* __restrict xq,
                        const double* __restrict yp, const double* __restrict yq,
                        double* __restrict p, double* __restrict q, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i)
        put<F>(p, q, i, F::combine(get<F>(xp, xq, i), get<F>(yp, yq, i)));
}

// What two calls of combine would do, the second of which combines elements twice as far apart.
template <class F>
RTAMT_LOOP void combine_four(const double* __restrict xp, const double* __restrict xq,
                             std::size_t apart, double* __restrict p, double* __restrict q,
                             std::size_t n) {
    const auto pair = [=](std::size_t i) {
        return F::combine(get<F>(xp, xq, i), get<F>(xp, xq, i + apart));
    };
    for (std::size_t i = 0; i < n; ++i) put<F>(p, q, i, F::combine(pair(i), pair(i + 2 * apart)));
}

template <class F>
RTAMT_LOOP void combine_results(const double* __restrict xp, const double* __restrict xq,
                                const double* __restrict yp, const double* __restrict yq,
                                double* __restrict out, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i)
        out[i] = F::result(F::combine(get<F>(xp, xq, i), get<F>(yp, yq, i)));
}

// The least or greatest of elements among which there is no -0.0: one comparison for each.
template <class F>
struct WithoutMinusZero : F {
    static double combine(double x, double y) {
        if constexpr (F::identity > 0) {
            return y < x ? y : x;
        } else {
            return y > x ? y : x;
        }
    }
};

RTAMT_LOOP void copy_and_find_minus_zero(const double* __restrict in, double* __restrict out,
                                         std::size_t n, bool* found) {
    std::uint64_t zeros = 0;
    for (std::size_t i = 0; i < n; ++i) {
        out[i] = in[i];
        zeros |= bits_of(in[i]) == bits_of(-0.0) ? 1u : 0u;
    }
    *found = zeros != 0;
}

// A window of 2 elements or more, but not very many: windows of 2, 4, 8, ... elements are made from
// two of half that length, and the last from two that overlap, as folding an element twice changes
// nothing.
template <class F>
class Doubled final : public Memory {
public:
    Doubled(std::size_t length, std::size_t most)
        : length_(length),
          clean_(length - 1),
          lines_{Line(length + most), Line(length + most), Line(length + most)} {
        Line& raw = lines_[0];
        for (std::size_t i = 0; i + 1 < length; ++i) put<F>(raw.p(), raw.q(), i, F::identity);
    }

    void push(const Operands& in, double* out) override {
        const std::size_t before = length_ - 1;
        Line& raw = lines_[0];
        take(in, raw.p() + before, raw.q() + before);
        if constexpr (F::width == 1) {
            if (clean_ >= length_ - 1 + in.n) {
                fold<WithoutMinusZero<F>>(out, in.n);
            } else {
                fold<F>(out, in.n);
            }
        } else {
            fold<F>(out, in.n);
        }
        raw.keep(in.n, before);
    }

private:
    class Line {
    public:
        explicit Line(std::size_t n)
            : size_((n + 7) / 8 * 8), memory_(column_memory(F::width * size_)) {}
        double* p() { return memory_.get(); }
        double* q() { return memory_.get() + (F::width - 1) * size_; }
        Elements elements() { return {p(), q()}; }
        // Moves n elements from a place to the begin.
        void keep(std::size_t from, std::size_t n) {
            std::memmove(p(), p() + from, n * sizeof(double));
            if (F::width == 2) std::memmove(q(), q() + from, n * sizeof(double));
        }

    private:
        std::size_t size_;
        ColumnMemory memory_;
    };

    // Writes the folds of the n windows of the first line.
    template <class G>
    void fold(double* out, std::size_t n) {
        std::size_t size = 1;
        std::size_t count = length_ - 1 + n;
        Elements from = lines_[0].elements();
        int to = 1;
        for (; 4 * size < length_; size *= 4, to = 3 - to) {
            count -= 3 * size;
            widest<combine_four<G>>(from.p, from.q, size, lines_[to].p(), lines_[to].q(), count);
            from = lines_[to].elements();
        }
        for (; 2 * size < length_; size *= 2, to = 3 - to) {
            count -= size;
            const Elements next = from + size;
            widest<combine<G>>(from.p, from.q, next.p, next.q, lines_[to].p(), lines_[to].q(),
                               count);
            from = lines_[to].elements();
        }
        const Elements last = from + (length_ - size);
        widest<combine_results<G>>(from.p, from.q, last.p, last.q, out, n);
    }

    void take(const Operands& in, double* p, double* q) {
        const auto identities = [&](std::size_t from, std::size_t to) {
            for (; from < to; ++from) put<F>(p, q, from, F::identity);
        };
        identities(0, in.begin);
        bool minus_zero = false;
        if (in.end > in.begin) {
            const std::size_t inside = in.end - in.begin;
            if constexpr (F::width == 1) {
                widest<copy_and_find_minus_zero>(in.a + in.begin, p + in.begin, inside,
                                                 &minus_zero);
            } else {
                std::copy_n(in.a + in.begin, inside, p + in.begin);
                std::copy_n(in.b + in.begin, inside, q + in.begin);
            }
        }
        clean_ = minus_zero ? 0 : clean_ + in.n;
        identities(std::max(in.begin, in.end), in.n);
    }

    std::size_t length_;
    std::size_t clean_;  // at least as many of the last elements are not -0.0
    Line lines_[3];
};

}  // namespace rtamt::trace

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
        : machine_(machine),
          registers_(machine, most),
          columns_(columns),
          n_(n),
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
        for (const Load& load : machine_.loads_)
            registers_.point(load.out, registers_.out(load.out));
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
        if (std::any_of(formulas.begin(), formulas.end(), writes))
            registers_.write_to(slot, output);
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
                trace.write(trace.at(observed_[i].slot) + (first - time), first - late, end - first,
                            outputs[i - 1]);
        }
    }
    return n;
}

namespace {

constexpr std::size_t kRunBlock = 256;

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
    Block block(*this, std::min(n, kRunBlock));
    if (const std::size_t bad = block.first_refused(columns, n); bad < n) return bad;
    std::size_t count = 0;
    for (std::size_t from = 0; from < n; from += count) {
        count = std::min(kRunBlock, n - from);
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
