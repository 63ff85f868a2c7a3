#include "batch/clocks.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "core/order.hpp"

namespace rtamt {
namespace {

// More samples than an episode has.
constexpr std::int64_t kNever = kMaxSamples;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// The row of a ring for a number of samples. Entries have mostly as many as the entry before, and a
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

EntryClock::EntryClock(ClockRow row, std::size_t num)
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
    reset(Entries(num));
}

void EntryClock::reset(const Entries& entries) {
    for (std::size_t i = 0; i < entries.count(); ++i) {
        const std::size_t entry = entries[i];
        count_[entry] = start_;
        shown_[entry] = 0;
        for (std::size_t at = entry; at < recent_.size(); at += num_) recent_[at] = 0;
        for (Operand& operand : operands_) {
            operand.value[entry] = kNan;
            for (std::size_t at = entry; at < operand.waiting.size(); at += num_)
                operand.waiting[at] = kNan;
        }
    }
}

void EntryClock::feed(const Entries& entries, const std::int64_t* samples, const double* parts) {
    for (std::size_t o = 0; o < operands_.size(); ++o) {
        const ClockRow::Operand& its = row_.operands[o];
        const double* newest = parts + its.part * num_;
        double* value = operands_[o].value.data();
        double* waiting = operands_[o].waiting.data();
        RingRow row(its.waits);
        for (std::size_t i = 0; i < entries.count(); ++i) {
            const std::size_t entry = entries[i];
            value[entry] = newest[entry];
            if (its.waits > 0) std::swap(value[entry], waiting[row(samples[entry]) * num_ + entry]);
        }
    }
    const auto each = [&](auto step) {
        for (std::size_t i = 0; i < entries.count(); ++i) step(std::size_t{entries[i]});
    };
    switch (row_.kind) {
        case ClockRow::Kind::oldest:
            if (depth_ > 0)
                each([&, row = RingRow(depth_)](std::size_t entry) mutable {
                    recent_[row(samples[entry]) * num_ + entry] =
                        is_asked(entry, samples[entry], parts);
                });
            each([&](std::size_t entry) { step_oldest(entry, samples[entry], parts); });
            break;
        case ClockRow::Kind::newest:
            each([&](std::size_t entry) { step_newest(entry, samples[entry], parts); });
            break;
        case ClockRow::Kind::last:
            each([&](std::size_t entry) { step_last(entry, samples[entry]); });
            break;
    }
}

// What operands do is random to a processor: the steps choose between numbers, without branches.

bool EntryClock::holds(std::size_t operand, std::size_t entry) const {
    const double value = operands_[operand].value[entry];
    return !negative(value) & (value == value);  // false of nan
}

bool EntryClock::fails(std::size_t operand, std::size_t entry) const {
    const double value = operands_[operand].value[entry];
    return negative(value) & (value == value);
}

bool EntryClock::is_asked(std::size_t entry, std::int64_t samples, const double* parts) const {
    if (row_.asked >= 0)
        return !negative(parts[static_cast<std::size_t>(row_.asked) * num_ + entry]);
    return !row_.first || samples == 0;
}

void EntryClock::step_oldest(std::size_t entry, std::int64_t samples, const double* parts) {
    const std::int64_t before = count_[entry];
    const bool asked = is_asked(entry, samples, parts);
    const std::int64_t count = before > 0 ? std::min(before + 1, most_) : std::int64_t{asked};
    Counts found{};
    if (operands_.size() == 1) {
        const bool event = row_.event == ClockRow::Event::fails ? fails(0, entry) : holds(0, entry);
        found.count = found.shown = ended(event, row_.begin, entry, samples, count);
    } else {
        found = of_two(entry, samples, count);
    }
    if (row_.first && before >= full_) found = {full_, full_};
    count_[entry] = found.count;
    shown_[entry] = found.shown;
}

EntryClock::Counts EntryClock::of_two(std::size_t entry, std::int64_t samples,
                                      std::int64_t count) const {
    const bool failed = fails(0, entry);
    const bool reached = holds(1, entry);
    const bool until = row_.event == ClockRow::Event::until;
    if (until) count = ended(reached, row_.begin, entry, samples, count);
    const bool done = until ? failed & (count > row_.late) : reached & (count > row_.begin);
    const std::int64_t left = ended(failed, row_.late, entry, samples, count);
    return {done && row_.first ? full_ : left, done ? full_ : until ? count : left};
}

std::int64_t EntryClock::ended(bool event, std::int64_t last, std::size_t entry,
                               std::int64_t samples, std::int64_t count) const {
    const bool over = event & (count > last);
    if (row_.asked < 0 || row_.first || last == 0) return over ? (row_.first ? 0 : last) : count;
    if (!over) return count;
    for (std::int64_t left = last; left > 0; --left) {  // the oldest first
        const std::size_t at = static_cast<std::size_t>(samples) + depth_ + 1;
        if (recent_[(at - static_cast<std::size_t>(left)) % depth_ * num_ + entry]) return left;
    }
    return 0;
}

void EntryClock::step_newest(std::size_t entry, std::int64_t samples, const double* parts) {
    const std::int64_t older = std::min(count_[entry] + 1, kNever);
    const std::int64_t age = is_asked(entry, samples, parts) ? 0 : older;
    bool over = false;
    if (row_.event == ClockRow::Event::until) over = fails(0, entry) & (age >= row_.late);
    if (row_.event == ClockRow::Event::unless) over = holds(1, entry) & (age >= row_.begin);
    count_[entry] = over ? kNever : age;
}

void EntryClock::step_last(std::size_t entry, std::int64_t samples) {
    const std::size_t operand = operands_.size() - 1;
    const bool event =
        row_.event == ClockRow::Event::fails ? fails(operand, entry) : holds(operand, entry);
    bool gone = samples < row_.late;
    if (row_.event == ClockRow::Event::since) gone |= fails(0, entry);
    const std::int64_t count = count_[entry] + (row_.end >= 0 ? 1 : 0);
    count_[entry] = event ? 0 : gone ? full_ : std::min(count, full_);
}

void EntryClock::write_fractions(double* out) const {
    const auto& counts = row_.kind == ClockRow::Kind::oldest ? shown_ : count_;
    const auto whole = static_cast<double>(full_);
    for (std::size_t entry = 0; entry < num_; ++entry) {
        if (row_.kind != ClockRow::Kind::newest)
            out[entry] = static_cast<double>(counts[entry]) / whole;
        else if (row_.end < 0)
            out[entry] = counts[entry] < kNever ? 1.0 : 0.0;
        else
            out[entry] =
                static_cast<double>(std::max<std::int64_t>(row_.end - counts[entry], 0)) / whole;
    }
}

void EntryClock::write_margins(double* out) const {
    for (const Operand& operand : operands_)
        for (const double value : operand.value) *out++ = value == value ? value : 0.0;
}

void EntryClock::add_to(Fingerprint& print) const {
    print.add(static_cast<int>(row_.kind), static_cast<int>(row_.event), row_.begin, row_.end,
              row_.late, row_.asked, row_.first, row_.operands.size());
    for (const ClockRow::Operand& operand : row_.operands) print.add(operand.part, operand.waits);
}

void EntryClock::fields(Snapshot& s) {
    s.array(count_.data(), num_);
    s.array(shown_.data(), num_);
    for (std::size_t entry = 0; entry < num_; ++entry) {
        s.require(count_[entry] >= 0 && count_[entry] <= std::max(full_, start_));
        s.require(shown_[entry] >= 0 && shown_[entry] <= full_);
    }
    s.array(recent_.data(), recent_.size());
    for (Operand& operand : operands_) {
        s.array(operand.value.data(), num_);
        s.array(operand.waiting.data(), operand.waiting.size());
    }
}

ClockBatch::ClockBatch(std::vector<ClockRow> rows, std::size_t parts, std::size_t num)
    : entries_(num), parts_(parts), samples_(num) {
    for (ClockRow& row : rows) {
        operands_ += row.operands.size();
        clocks_.emplace_back(std::move(row), num);
    }
}

void ClockBatch::feed(const double* parts, const std::uint8_t* mask) {
    entries_.choose(mask);
    for (EntryClock& clock : clocks_) clock.feed(entries_, samples_.data(), parts);
    for (std::size_t i = 0; i < entries_.count(); ++i) ++samples_[entries_[i]];
}

void ClockBatch::reset(const std::uint8_t* mask) {
    entries_.choose(mask);
    for (EntryClock& clock : clocks_) clock.reset(entries_);
    for (std::size_t i = 0; i < entries_.count(); ++i) samples_[entries_[i]] = 0;
}

void ClockBatch::write_fractions(double* out) const {
    for (const EntryClock& clock : clocks_) {
        clock.write_fractions(out);
        out += num();
    }
}

void ClockBatch::write_margins(double* out) const {
    for (const EntryClock& clock : clocks_) {
        clock.write_margins(out);
        out += clock.operands() * num();
    }
}

std::uint64_t ClockBatch::fingerprint() const {
    Fingerprint print;
    print.add(parts_, num(), clocks_.size());
    for (const EntryClock& clock : clocks_) clock.add_to(print);
    return print.value();
}

void ClockBatch::fields(Snapshot& s) {
    s.counts(samples_.data(), samples_.size());
    for (EntryClock& clock : clocks_) clock.fields(s);
}

}  // namespace rtamt
