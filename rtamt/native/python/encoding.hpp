// Reads programs as rtamt/program/encoding.py writes them.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <string>
#include <vector>

#include "dense/episode.hpp"
#include "dense/machine.hpp"
#include "dense/regions.hpp"
#include "discrete/machine.hpp"
#include "episode/machine.hpp"

namespace rtamt {

namespace nb = nanobind;

std::vector<DiscreteRow> discrete_rows(const nb::sequence& encoded);
std::vector<DenseRow> dense_rows(const nb::sequence& encoded);
std::vector<FormulaRow> formula_rows(const nb::sequence& encoded);
std::vector<dense::RegionConstant> region_constants(const nb::sequence& encoded);
std::vector<std::size_t> registers_of(const nb::sequence& numbers);

// Terms on samples as rows over dense time.
std::vector<DenseRow> dense_terms(const nb::sequence& encoded);

std::vector<double> numbers_of(const nb::sequence& given);

End end_of(const std::string& name);

}  // namespace rtamt
