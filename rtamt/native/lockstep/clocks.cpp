#include "lockstep/clocks.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "core/order.hpp"

namespace rtamt {
namespace {

// More samples than an episode has.
constexpr std::int64_t kNever = kMaxSamples;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// The row of a ring for a number of samples. Lanes have mostly as many as the lane before, and a
// division would take most of the time of a step.
class RingRow {
public:
    explicit RingRow(std::size_t rows) : rows_(rows) {}

    std::size_t operator()(std::int64_t samples) {
        if (samples != samples_) {
            samples_ = samples;
            row_ = static_cast<std::size_t>(samples) % rows_;
        }
        return row_;
    }

private:
    std::size_t rows_;
    std::size_t row_ = 0;
    std::int64_t samples_ = 0;
};

}  // namespace

LaneClock::LaneClock(ClockRow row, std::size_t num)
    : row_(std::move(row)), num_(num), operands_(row_.operands.size()), count_(num), shown_(num) {
    const bool endless = row_.end < 0;
    switch (row_.kind) {
        case ClockRow::Kind::oldest:
            full_ = endless ? row_.begin + 2 : row_.end + 1;
            most_ = endless ? row_.begin + 1 : full_;
            start_ = 0;
            break;
        case ClockRow::Kind::newest:
            full_ = most_ = std::max<std::int64_t>(row_.end, 1);
            start_ = kNever;
            break;
        case ClockRow::Kind::last:
            full_ = most_ = start_ = endless ? 1 : row_.end + 1;
            break;
    }
    const bool looks_back = row_.kind == ClockRow::Kind::oldest && row_.asked >= 0;
    depth_ = looks_back ? static_cast<std::size_t>(std::max(row_.begin, row_.late)) : 0;
    recent_.resize(depth_ * num);
    for (std::size_t i = 0; i < operands_.size(); ++i) {
        operands_[i].value.resize(num);
        operands_[i].waiting.resize(row_.operands[i].waits * num);
    }
    reset(Lanes(num));
}

void LaneClock::reset(const Lanes& lanes) {
    for (std::size_t i = 0; i < lanes.count(); ++i) {
        const std::size_t lane = lanes[i];
        count_[lane] = start_;
        shown_[lane] = 0;
        for (std::size_t at = lane; at < recent_.size(); at += num_) recent_[at] = 0;
        for (Operand& operand : operands_) {
            operand.value[lane] = kNan;
            for (std::size_t at = lane; at < operand.waiting.size(); at += num_)
                operand.waiting[at] = kNan;
        }
    }
}

void LaneClock::feed(const Lanes& lanes, const std::int64_t* samples,
                     const double* parts) {
    for (std::size_t o = 0; o < operands_.size(); ++o) {
        const ClockRow::Operand& its = row_.operands[o];
        const double* newest = parts + its.part * num_;
        double* value = operands_[o].value.data();
        double* waiting = operands_[o].waiting.data();
        RingRow row(its.waits);
        for (std::size_t i = 0; i < lanes.count(); ++i) {
            const std::size_t lane = lanes[i];
            value[lane] = newest[lane];
            if (its.waits > 0) std::swap(value[lane], waiting[row(samples[lane]) * num_ + lane]);
        }
    }
    const auto each = [&](auto step) {
        for (std::size_t i = 0; i < lanes.count(); ++i) step(std::size_t{lanes[i]});
    };
    switch (row_.kind) {
        case ClockRow::Kind::oldest:
            if (depth_ > 0)
                each([&, row = RingRow(depth_)](std::size_t lane) mutable {
                    recent_[row(samples[lane]) * num_ + lane] =
                        is_asked(lane, samples[lane], parts);
                });
            each([&](std::size_t lane) { step_oldest(lane, samples[lane], parts); });
            break;
        case ClockRow::Kind::newest:
            each([&](std::size_t lane) { step_newest(lane, samples[lane], parts); });
            break;
        case ClockRow::Kind::last:
            each([&](std::size_t lane) { step_last(lane, samples[lane]); });
            break;
    }
}

// What operands do is random to a processor: the steps choose between numbers, without branches.

bool LaneClock::holds(std::size_t operand, std::size_t lane) const {
    const double value = operands_[operand].value[lane];
    return !negative(value) & (value == value);  // false of nan
}

bool LaneClock::fails(std::size_t operand, std::size_t lane) const {
    const double value = operands_[operand].value[lane];
    return negative(value) & (value == value);
}

bool LaneClock::is_asked(std::size_t lane, std::int64_t samples,
                         const double* parts) const {
    if (row_.asked >= 0) return !negative(parts[static_cast<std::size_t>(row_.asked) * num_ + lane]);
    return !row_.first || samples == 0;
}

void LaneClock::step_oldest(std::size_t lane, std::int64_t samples, const double* parts) {
    const std::int64_t before = count_[lane];
    const bool asked = is_asked(lane, samples, parts);
    const std::int64_t count = before > 0 ? std::min(before + 1, most_) : std::int64_t{asked};
    Counts found{};
    if (operands_.size() == 1) {
        const bool event = row_.event == ClockRow::Event::fails ? fails(0, lane) : holds(0, lane);
        found.count = found.shown = ended(event, row_.begin, lane, samples, count);
    } else {
        found = of_two(lane, samples, count);
    }
    if (row_.first && before >= full_) found = {full_, full_};
    count_[lane] = found.count;
    shown_[lane] = found.shown;
}

LaneClock::Counts LaneClock::of_two(std::size_t lane, std::int64_t samples,
                                    std::int64_t count) const {
    const bool failed = fails(0, lane);
    const bool reached = holds(1, lane);
    const bool until = row_.event == ClockRow::Event::until;
    if (until) count = ended(reached, row_.begin, lane, samples, count);
    const bool done = until ? failed & (count > row_.late) : reached & (count > row_.begin);
    const std::int64_t left = ended(failed, row_.late, lane, samples, count);
    return {done && row_.first ? full_ : left, done ? full_ : until ? count : left};
}

std::int64_t LaneClock::ended(bool event, std::int64_t last, std::size_t lane,
                              std::int64_t samples, std::int64_t count) const {
    const bool over = event & (count > last);
    if (row_.asked < 0 || row_.first || last == 0) return over ? (row_.first ? 0 : last) : count;
    if (!over) return count;
    for (std::int64_t left = last; left > 0; --left) {  // the oldest first
        const std::size_t at = static_cast<std::size_t>(samples) + depth_ + 1;
        if (recent_[(at - static_cast<std::size_t>(left)) % depth_ * num_ + lane]) return left;
    }
    return 0;
}

void LaneClock::step_newest(std::size_t lane, std::int64_t samples, const double* parts) {
    const std::int64_t older = std::min(count_[lane] + 1, kNever);
    const std::int64_t age = is_asked(lane, samples, parts) ? 0 : older;
    bool over = false;
    if (row_.event == ClockRow::Event::until) over = fails(0, lane) & (age >= row_.late);
    if (row_.event == ClockRow::Event::unless) over = holds(1, lane) & (age >= row_.begin);
    count_[lane] = over ? kNever : age;
}

void LaneClock::step_last(std::size_t lane, std::int64_t samples) {
    const std::size_t operand = operands_.size() - 1;
    const bool event =
        row_.event == ClockRow::Event::fails ? fails(operand, lane) : holds(operand, lane);
    bool gone = samples < row_.late;
    if (row_.event == ClockRow::Event::since) gone |= fails(0, lane);
    const std::int64_t count = count_[lane] + (row_.end >= 0 ? 1 : 0);
    count_[lane] = event ? 0 : gone ? full_ : std::min(count, full_);
}

void LaneClock::write_fractions(double* out) const {
    const auto& counts = row_.kind == ClockRow::Kind::oldest ? shown_ : count_;
    const auto whole = static_cast<double>(full_);
    for (std::size_t lane = 0; lane < num_; ++lane) {
        if (row_.kind != ClockRow::Kind::newest)
            out[lane] = static_cast<double>(counts[lane]) / whole;
        else if (row_.end < 0)
            out[lane] = counts[lane] < kNever ? 1.0 : 0.0;
        else
            out[lane] =
                static_cast<double>(std::max<std::int64_t>(row_.end - counts[lane], 0)) / whole;
    }
}

void LaneClock::write_margins(double* out) const {
    for (const Operand& operand : operands_)
        for (const double value : operand.value) *out++ = value == value ? value : 0.0;
}

void LaneClock::add_to(Fingerprint& print) const {
    print.add(static_cast<int>(row_.kind), static_cast<int>(row_.event), row_.begin, row_.end,
              row_.late, row_.asked, row_.first, row_.operands.size());
    for (const ClockRow::Operand& operand : row_.operands) print.add(operand.part, operand.waits);
}

void LaneClock::fields(Snapshot& s) {
    s.array(count_.data(), num_);
    s.array(shown_.data(), num_);
    for (std::size_t lane = 0; lane < num_; ++lane) {
        s.require(count_[lane] >= 0 && count_[lane] <= std::max(full_, start_));
        s.require(shown_[lane] >= 0 && shown_[lane] <= full_);
    }
    s.array(recent_.data(), recent_.size());
    for (Operand& operand : operands_) {
        s.array(operand.value.data(), num_);
        s.array(operand.waiting.data(), operand.waiting.size());
    }
}

ClockBank::ClockBank(std::vector<ClockRow> rows, std::size_t parts, std::size_t num)
    : lanes_(num), parts_(parts), samples_(num) {
    for (ClockRow& row : rows) {
        operands_ += row.operands.size();
        clocks_.emplace_back(std::move(row), num);
    }
}

void ClockBank::feed(const double* parts, const std::uint8_t* mask) {
    lanes_.choose(mask);
    for (LaneClock& clock : clocks_) clock.feed(lanes_, samples_.data(), parts);
    for (std::size_t i = 0; i < lanes_.count(); ++i) ++samples_[lanes_[i]];
}

void ClockBank::reset(const std::uint8_t* mask) {
    lanes_.choose(mask);
    for (LaneClock& clock : clocks_) clock.reset(lanes_);
    for (std::size_t i = 0; i < lanes_.count(); ++i) samples_[lanes_[i]] = 0;
}

void ClockBank::write_fractions(double* out) const {
    for (const LaneClock& clock : clocks_) {
        clock.write_fractions(out);
        out += num();
    }
}

void ClockBank::write_margins(double* out) const {
    for (const LaneClock& clock : clocks_) {
        clock.write_margins(out);
        out += clock.operands() * num();
    }
}

std::uint64_t ClockBank::fingerprint() const {
    Fingerprint print;
    print.add(parts_, num(), clocks_.size());
    for (const LaneClock& clock : clocks_) clock.add_to(print);
    return print.value();
}

void ClockBank::fields(Snapshot& s) {
    s.counts(samples_.data(), samples_.size());
    for (LaneClock& clock : clocks_) clock.fields(s);
}

}  // namespace rtamt
