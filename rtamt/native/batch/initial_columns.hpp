// Registers that are read at time 0 alone, as columns: the values of every entry in three worlds.
#pragma once

#include <algorithm>
#include <array>
#include <iterator>
#include <memory>
#include <optional>
#include <vector>

#include "batch/clamped_columns.hpp"

namespace rtamt::batch {

class InitialColumns {
public:
    explicit InitialColumns(std::size_t num) {
        for (auto& world : worlds_) world.resize(num);
    }
    InitialColumns(const InitialColumns&) = delete;
    InitialColumns& operator=(const InitialColumns&) = delete;
    virtual ~InitialColumns() = default;

    double* world(World w) { return worlds_[w].data(); }

    // Forgets the samples of the chosen entries.
    virtual void reset(const Entries& entries) = 0;
    virtual void take(const Taken& taken) = 0;
    // Finds the values of the chosen entries in every world; if `ended`, without the future of
    // operators that have no end.
    virtual void conclude(const Entries& entries, const std::int64_t* samples, bool ended) = 0;
    virtual void fields(Snapshot& s) {
        for (auto& world : worlds_) s.array(world.data(), world.size());
    }

protected:
    std::array<std::vector<double>, std::size(kAll)> worlds_;
};

// A constant, or the value of a term at the first sample.
class TermColumns final : public InitialColumns {
public:
    TermColumns(std::size_t num, std::size_t term, std::optional<double> constant)
        : InitialColumns(num), term_(term), constant_(constant) {}

    void reset(const Entries& entries) override {
        for (std::size_t i = 0; i < entries.count(); ++i)
            for (World w : kAll)
                worlds_[w][entries[i]] = constant_     ? *constant_
                                         : w == kLower ? -kInfinity
                                                       : kInfinity;
    }
    void take(const Taken& t) override {
        if (t.first > 0) return;
        const double* values = t.columns.at(term_);
        for (std::size_t i = 0; i < t.entries.count(); ++i) {
            const std::uint32_t entry = t.entries[i];
            if (t.times[entry] == 0)
                for (World w : kAll) worlds_[w][entry] = values[i];
        }
    }
    void conclude(const Entries&, const std::int64_t*, bool) override {}

private:
    std::size_t term_;
    std::optional<double> constant_;
};

template <double (*choose)(double, double)>
class MapColumns final : public InitialColumns {
public:
    MapColumns(std::size_t num, InitialColumns& a, InitialColumns& b)
        : InitialColumns(num), a_(a), b_(b) {}

    void reset(const Entries&) override {}
    void take(const Taken&) override {}
    void conclude(const Entries& entries, const std::int64_t*, bool) override {
        for (World w : kAll) {
            const double* a = a_.world(w);
            const double* b = b_.world(w);
            double* out = world(w);
            each_stretch(entries, true, [&](std::size_t entry, std::size_t, std::size_t n) {
                columns::map<choose>(a + entry, b + entry, out + entry, n);
            });
        }
    }

private:
    InitialColumns& a_;
    InitialColumns& b_;
};

// What a register is at unseen samples, in every world.
using Tails = std::array<double, std::size(kAll)>;

// The operand of a fold is the least of these (under Most, the greatest).
struct FoldOperand {
    std::vector<std::size_t> plain;  // registers without a window
    std::vector<ClampedWindow> windows;
    Tails tail;          // at unseen samples
    bool guard = false;  // whether these are there if what they guard is
};

// The fold over the times begin to end.
template <class Order>
class FoldColumns final : public InitialColumns {
public:
    FoldColumns(std::size_t num, const FoldOperand& operand, Time begin, Time end)
        : InitialColumns(num), operand_(operand), begin_(begin), end_(end), settled_(num) {
        for (const ClampedWindow& window : operand.windows) windows_.push_back(made(window));
        if (!windows_.empty())
            for (World w : {kLower, kUpper}) open_[w].resize(num);
    }

    void reset(const Entries& entries) override {
        for (std::size_t i = 0; i < entries.count(); ++i) {
            const std::uint32_t entry = entries[i];
            settled_[entry] = Order::top;
            world(kNow)[entry] = Order::top;
            if (windows_.empty()) continue;
            for (World w : {kBest, kWorst}) open_[w][entry] = Order::top;
        }
        for (const auto& window : windows_) window->reset(entries);
    }

    void take(const Taken& t) override {
        for (const std::size_t plain : operand_.plain) fold_plain(t, t.columns.at(plain));
        if (windows_.empty()) return;
        const Seen seen{settled_.data(), world(kNow), open_[kBest].data(), open_[kWorst].data()};
        each_stretch(t.entries, true, [&](std::size_t entry, std::size_t, std::size_t n) {
            std::fill_n(seen.now + entry, n, Order::top);
            std::fill_n(seen.best + entry, n, Order::top);
            std::fill_n(seen.worst + entry, n, Order::top);
        });
        for (const auto& window : windows_) window->take(t, begin_, end_, seen);
    }

    void conclude(const Entries& entries, const std::int64_t* samples, bool ended) override {
        const bool to_the_end = ended && end_ == kNever;
        const double* settled = settled_.data();
        double* now = world(kNow);
        double* best_world = world(kBest);
        double* worst_world = world(kWorst);
        const auto run = [&](std::size_t entry, std::size_t, std::size_t n) RTAMT_LOOP_BODY {
            const std::size_t stop = entry + n;
            if (windows_.empty()) {
                std::copy(settled + entry, settled + stop, now + entry);
                std::copy(settled + entry, settled + stop, best_world + entry);
                std::copy(settled + entry, settled + stop, worst_world + entry);
            } else {
                const double* best = open_[kBest].data();
                const double* worst = open_[kWorst].data();
                RTAMT_INDEPENDENT
                for (std::size_t i = entry; i < stop; ++i) {
                    now[i] = Order::least(now[i], settled[i]);
                    best_world[i] = Order::least(best[i], settled[i]);
                    worst_world[i] = Order::least(worst[i], settled[i]);
                }
            }
            if (!to_the_end) add_tails(samples, ended, entry, stop);
        };
        each_stretch(entries, true, run);
    }

    void fields(Snapshot& s) override {
        InitialColumns::fields(s);
        s.array(settled_.data(), settled_.size());
        for (auto& open : open_) s.array(open.data(), open.size());
        for (const auto& window : windows_) window->fields(s);
    }

private:
    static constexpr World kBest = Order::top > 0 ? kUpper : kLower;
    static constexpr World kWorst = Order::top > 0 ? kLower : kUpper;

    std::unique_ptr<WindowColumns> made(const ClampedWindow& window) const {
        constexpr bool kMin = Order::top > 0;
        const std::size_t num = settled_.size();
        const bool best_is_top = kMin ? !window.clamped_above : !window.clamped_below;
        const bool worst_is_least = kMin ? !window.clamped_below : !window.clamped_above;
        if (window.is_min == kMin)
            return std::make_unique<ClampedColumns<Order, Clamps<Order, true>>>(num, window);
        if (!best_is_top)
            return std::make_unique<ClampedColumns<Order, Clamps<Order, false>>>(num, window);
        if (worst_is_least && end_ == kNever)  // what has no end begins at time 0
            return std::make_unique<ReachedColumns<Order>>(num, window);
        return std::make_unique<ClampedColumns<Order, Reaches<Order>>>(num, window);
    }

    // Adds what unseen samples may be, in the entries from `entry` to `stop` in which some count.
    RTAMT_LOOP void add_tails(const std::int64_t* samples, bool ended, std::size_t entry,
                              std::size_t stop) {
        const double best_tail = operand_.tail[kBest];
        const double worst_tail = operand_.tail[kWorst];
        // But for the sample of time 0, they may not be there.
        const bool there = ended || operand_.guard;
        const Time first = begin_ == 0 ? 0 : -1;
        const Time end = end_;
        double* best = world(kBest);
        double* worst = world(kWorst);
        RTAMT_INDEPENDENT
        for (std::size_t i = entry; i < stop; ++i) {
            const bool count = samples[i] <= end;
            const double least = Order::least(best[i], best_tail);
            best[i] = count & (there | (samples[i] == first)) ? least : best[i];
            worst[i] = count ? Order::least(worst[i], worst_tail) : worst[i];
        }
    }

    void fold_plain(const Taken& t, const double* values) {
        double* settled = settled_.data();
        if (t.first >= begin_ && t.last <= end_) {
            each_stretch(t.entries, true,
                         [&](std::size_t entry, std::size_t i, std::size_t n) RTAMT_LOOP_BODY {
                             RTAMT_INDEPENDENT
                             for (std::size_t j = 0; j < n; ++j)
                                 settled[entry + j] =
                                     Order::least(settled[entry + j], values[i + j]);
                         });
            return;
        }
        for (std::size_t i = 0; i < t.entries.count(); ++i) {
            const std::uint32_t entry = t.entries[i];
            const Time time = t.times[entry];
            if (time >= begin_ && time <= end_)
                settled[entry] = Order::least(settled[entry], values[i]);
        }
    }

    FoldOperand operand_;
    Time begin_;
    Time end_;
    std::vector<double> settled_;
    std::array<std::vector<double>, std::size(kAll)>
        open_;  // of open windows, if there are windows
    std::vector<std::unique_ptr<WindowColumns>> windows_;
};

}  // namespace rtamt::batch
