// Episodes in batches with neutral predicates or uncertain values; see episode/variants.hpp.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "episode/variants.hpp"
#include "batch/machines.hpp"

namespace rtamt {

// The best variant runs until no entry is left whose episode has an uncertain value.
class BatchVariants : public VariantsOf<EpisodeBatch> {
public:
    BatchVariants(episode::Program program, std::vector<std::size_t> neutral, std::size_t num)
        : VariantsOf(std::move(program), std::move(neutral), num),
          uncertain_(num),
          moved_(num, std::nan("")),
          results_(num, std::nan("")) {}

    std::size_t num() const { return uncertain_.size(); }
    const double* results() const { return several() ? results_.data() : result_->results(); }

    // Takes samples in as DiscreteBatch does.
    std::size_t take(const Table& table, const std::uint8_t* mask);
    // Takes in a sample of every chosen entry that lies between two rows. Returns the first entry
    // in which a term has no value, without changing any entry, or num().
    std::size_t take(const Table& lower, const Table& upper, const std::uint8_t* mask);
    void reset(const std::uint8_t* mask = nullptr);
    void finish(const std::uint8_t* mask, End end);
    void fields(Snapshot& s);

private:
    void publish();

    std::vector<std::uint8_t> uncertain_;  // the entries with an uncertain value
    std::vector<double> moved_;  // the robustness of ended entries, inside the bounds of all
    std::vector<double> results_;  // where variants differ
};

}  // namespace rtamt
