#include "lockstep/uncertain.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace rtamt {

UncertainBank::UncertainBank(std::vector<DiscreteRow> terms, std::size_t variables,
                             std::vector<episode::FormulaRow> formulas,
                             std::vector<std::size_t> initial, std::vector<std::size_t> streams,
                             std::size_t num)
    : least_(std::make_unique<EpisodeBank>(terms, variables, formulas, initial, streams, num)),
      uncertain_(num),
      moved_(num, std::nan("")),
      results_(num),
      program_{std::move(terms), std::move(formulas), std::move(initial), std::move(streams)} {}

std::size_t UncertainBank::take(const Table& table, const std::uint8_t* mask) {
    const std::size_t bad = least_->take(table, mask);
    if (apart_ && bad == num()) {
        greatest_->take(table, mask);
        publish();
    }
    return bad;
}

std::size_t UncertainBank::take(const Table& lower, const Table& upper, const std::uint8_t* mask) {
    if (!ranges_) ranges_ = std::make_unique<TermRanges>(program_.terms, variables());
    const std::size_t terms = ranges_->terms();
    least_terms_.resize(terms * num());
    greatest_terms_.resize(terms * num());
    std::vector<std::uint8_t> uncertain = uncertain_;
    std::vector<double> low(variables());
    std::vector<double> high(variables());
    std::size_t i = 0;
    for (std::size_t lane = 0; lane < num(); ++lane) {
        if (mask != nullptr && !mask[lane]) continue;
        const auto row = static_cast<std::ptrdiff_t>(lane);
        for (std::size_t v = 0; v < variables(); ++v) {
            low[v] = lower.at(v)[row * lower.row];
            high[v] = upper.at(v)[row * upper.row];
            uncertain[lane] |= !same(low[v], high[v]);
        }
        if (!ranges_->find(low.data(), high.data(), 1)) return lane;
        for (std::size_t k = 0; k < terms; ++k) {
            least_terms_[k * num() + i] = (*ranges_)[k].lower;
            greatest_terms_[k * num() + i] = (*ranges_)[k].upper;
        }
        ++i;
    }
    if (std::any_of(uncertain.begin(), uncertain.end(), [](std::uint8_t u) { return u != 0; }))
        part();
    least_->take(lower, mask, least_terms_.data());
    if (apart_) greatest_->take(upper, mask, greatest_terms_.data());
    uncertain_ = std::move(uncertain);
    publish();
    return num();
}

void UncertainBank::reset(const std::uint8_t* mask) {
    least_->reset(mask);
    if (!apart_) return;
    greatest_->reset(mask);
    bool left = false;
    for (std::size_t lane = 0; lane < num(); ++lane) {
        if (mask == nullptr || mask[lane]) {
            uncertain_[lane] = 0;
            moved_[lane] = std::nan("");
        }
        left |= uncertain_[lane] != 0;
    }
    apart_ = left;
    publish();
}

void UncertainBank::finish(const std::uint8_t* mask, End end) {
    if (!apart_) return least_->finish(mask, end);
    const std::vector<std::uint8_t> before(finished(), finished() + num());
    const std::vector<double> robustness(results(), results() + num());
    least_->finish(mask, end);
    greatest_->finish(mask, end);
    for (std::size_t lane = 0; lane < num(); ++lane)
        if (end == End::cut && finished()[lane] && !before[lane])
            moved_[lane] = moved(robustness[lane], lower()[lane], upper()[lane]);
    publish();
}

void UncertainBank::publish() {
    if (!apart_) return;
    for (std::size_t lane = 0; lane < num(); ++lane)
        results_[lane] = moved_[lane] == moved_[lane] ? moved_[lane] : least_->results()[lane];
}

void UncertainBank::part() {
    if (apart_) return;
    if (!greatest_)
        greatest_ = std::make_unique<EpisodeBank>(program_.terms, variables(), program_.formulas,
                                                  program_.initial, program_.streams, num());
    restore_from(*greatest_, state_of(*least_));
    apart_ = true;
    std::fill(moved_.begin(), moved_.end(), std::nan(""));
}

void UncertainBank::fields(Snapshot& s) {
    bool apart = apart_;
    s(apart);
    least_->fields(s);
    if (!apart) return;
    if (s.reads()) part();
    greatest_->fields(s);
    s.array(uncertain_.data(), uncertain_.size());
    s.array(moved_.data(), moved_.size());
    publish();
    for (std::size_t lane = 0; lane < num(); ++lane)
        s.require(least_->samples()[lane] == greatest_->samples()[lane] &&
                  least_->finished()[lane] == greatest_->finished()[lane]);
}

}  // namespace rtamt
