#include "batch/variants.hpp"

#include <algorithm>

namespace rtamt {

std::size_t BatchVariants::take(const Table& table, const std::uint8_t* mask) {
    const std::size_t bad = result_->take(table, mask);
    if (several() && bad == num()) {
        if (worst_) worst_->take(table, mask);
        if (apart()) best_->take(table, mask);
        publish();
    }
    return bad;
}

std::size_t BatchVariants::take(const Table& lower, const Table& upper, const std::uint8_t* mask) {
    const std::size_t terms = ranges().terms();
    least_terms_.resize(terms * num());
    greatest_terms_.resize(terms * num());
    std::vector<std::uint8_t> uncertain = uncertain_;
    std::vector<double> low(variables());
    std::vector<double> high(variables());
    std::size_t i = 0;
    for (std::size_t entry = 0; entry < num(); ++entry) {
        if (mask != nullptr && !mask[entry]) continue;
        const auto row = static_cast<std::ptrdiff_t>(entry);
        for (std::size_t v = 0; v < variables(); ++v) {
            low[v] = lower.at(v)[row * lower.row];
            high[v] = upper.at(v)[row * upper.row];
            uncertain[entry] |= !same(low[v], high[v]);
        }
        if (!ranges().find(low.data(), high.data(), 1)) return entry;
        for (std::size_t k = 0; k < terms; ++k) {
            least_terms_[k * num() + i] = ranges()[k].lower;
            greatest_terms_[k * num() + i] = ranges()[k].upper;
        }
        ++i;
    }
    if (std::any_of(uncertain.begin(), uncertain.end(), [](std::uint8_t u) { return u != 0; }))
        part(num());
    result_->take(lower, mask, least_terms_.data());
    if (apart()) best_->take(upper, mask, greatest_terms_.data());
    if (worst_) {
        for (const std::size_t term : neutral_)
            std::fill_n(least_terms_.data() + term * num(), num(), -0.0);
        worst_->take(lower, mask, least_terms_.data());
    }
    uncertain_ = std::move(uncertain);
    publish();
    return num();
}

void BatchVariants::reset(const std::uint8_t* mask) {
    each([=](EpisodeBatch& batch) { batch.reset(mask); });
    for (std::size_t entry = 0; entry < num(); ++entry) {
        if (mask != nullptr && !mask[entry]) continue;
        uncertain_[entry] = 0;
        moved_[entry] = std::nan("");
    }
    if (std::find(uncertain_.begin(), uncertain_.end(), 1) == uncertain_.end()) join();
    publish();
}

void BatchVariants::finish(const std::uint8_t* mask, End end) {
    if (!several()) return result_->finish(mask, end);
    const std::vector<std::uint8_t> before(finished(), finished() + num());
    const std::vector<double> robustness(results(), results() + num());
    each([=](EpisodeBatch& batch) { batch.finish(mask, end); });
    for (std::size_t entry = 0; entry < num(); ++entry)
        if (finished()[entry] && !before[entry])
            moved_[entry] = moved(robustness[entry], lower()[entry], upper()[entry]);
    publish();
}

void BatchVariants::publish() {
    if (!several()) return;
    for (std::size_t entry = 0; entry < num(); ++entry)
        results_[entry] =
            moved_[entry] == moved_[entry] ? moved_[entry] : result_->results()[entry];
}

void BatchVariants::fields(Snapshot& s) {
    fields_of_all(s, num());
    if (!several()) return;
    s.array(uncertain_.data(), uncertain_.size());
    s.array(moved_.data(), moved_.size());
    publish();
    each([&](EpisodeBatch& batch) {
        for (std::size_t entry = 0; entry < num(); ++entry)
            s.require(batch.samples()[entry] == samples()[entry] &&
                      batch.finished()[entry] == finished()[entry]);
    });
}

}  // namespace rtamt
