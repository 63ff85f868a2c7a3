// Programs as Python encodes them.
#pragma once

#include <nanobind/nanobind.h>

#include <vector>

#include "discrete/machine.hpp"
#include "episode/machine.hpp"

namespace rtamt {

namespace nb = nanobind;

inline std::vector<Row> rows_of(const nb::sequence& encoded) {
    std::vector<Row> rows;
    rows.reserve(nb::len(encoded));
    for (nb::handle handle : encoded) {
        const auto row = nb::cast<nb::tuple>(handle);
        if (nb::len(row) != 8) throw nb::value_error("expected rows of 8");
        rows.push_back({nb::cast<std::size_t>(row[0]), nb::cast<const char*>(row[1]),
                        nb::cast<const char*>(row[2]), nb::cast<std::size_t>(row[3]),
                        nb::cast<std::size_t>(row[4]), nb::cast<double>(row[5]),
                        nb::cast<std::size_t>(row[6]), nb::cast<std::int64_t>(row[7])});
    }
    return rows;
}

// Rows as rtamt/program/encoding.py names their fields.
inline std::vector<episode::Formula> formulas_of(const nb::sequence& encoded) {
    std::vector<episode::Formula> formulas;
    formulas.reserve(nb::len(encoded));
    for (nb::handle handle : encoded) {
        const auto row = nb::cast<nb::tuple>(handle);
        if (nb::len(row) != 6) throw nb::value_error("expected rows of 6");
        const auto bound = [](nb::handle value, episode::Time none) {
            return value.is_none() ? none : nb::cast<episode::Time>(value);
        };
        formulas.push_back({nb::cast<const char*>(row[0]), nb::cast<const char*>(row[1]),
                            nb::cast<std::size_t>(row[2]), nb::cast<std::size_t>(row[3]),
                            bound(row[4], -episode::kNever), bound(row[5], episode::kNever)});
    }
    return formulas;
}

inline std::vector<std::size_t> registers_of(const nb::sequence& numbers) {
    std::vector<std::size_t> registers;
    for (nb::handle number : numbers) registers.push_back(nb::cast<std::size_t>(number));
    return registers;
}

}  // namespace rtamt
