// The terms of a program at many samples. The definition is term_columns in
// rtamt/machines/terms.py.
#pragma once

#include <algorithm>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/columns.hpp"
#include "dense/sampler.hpp"
#include "discrete/machine.hpp"

namespace rtamt::dense {

class TermColumns {
public:
    // Throws std::invalid_argument on rows that are no terms.
    TermColumns(const std::vector<DiscreteRow>& rows, std::size_t variables) : rows_(rows) {
        for (std::size_t i = 0; i < rows.size(); ++i) {
            const DiscreteRow& row = rows[i];
            functions_.push_back(row.kind == "MAP" ? function_named(row.name) : nullptr);
            if (!is_term(row, i, variables) || row.slot != i)
                throw std::invalid_argument("row " + std::to_string(i) + " is no term");
        }
    }

    std::size_t size() const { return rows_.size(); }

    // Computes a column for each term from one for each variable. Returns the first sample with a
    // term that is nan, behind which nothing need be computed; n if there is none.
    std::size_t compute(const double* const* variables, double* const* out, std::size_t n) const {
        constexpr std::size_t kBlock = 512;  // samples that stay in the cache
        for (std::size_t at = 0; at < n; at += kBlock) {
            const std::size_t size = std::min(kBlock, n - at);
            std::size_t fine = size;
            for (std::size_t i = 0; i < rows_.size(); ++i) {
                const DiscreteRow& row = rows_[i];
                if (functions_[i]) {
                    functions_[i](out[row.a] + at, out[row.b] + at, out[i] + at, size);
                    fine = columns::first_nan(out[i] + at, fine);
                } else if (row.kind == "LOAD") {
                    std::copy_n(variables[row.a] + at, size, out[i] + at);
                } else {
                    std::fill_n(out[i] + at, size, row.value);
                }
            }
            if (fine < size) return at + fine;
        }
        return n;
    }

private:
    std::vector<DiscreteRow> rows_;
    std::vector<Function> functions_;  // null: none
};

}  // namespace rtamt::dense
