#include "python/encoding.hpp"

#include <nanobind/stl/optional.h>

#include <cstdint>
#include <optional>

namespace rtamt {
namespace {

// Rows from tuples of their fields.
template <class Row, class... Fields>
std::vector<Row> rows_of(const nb::sequence& encoded) {
    std::vector<Row> rows;
    rows.reserve(nb::len(encoded));
    for (nb::handle handle : encoded) {
        const auto row = nb::cast<nb::tuple>(handle);
        if (nb::len(row) != sizeof...(Fields))
            throw nb::value_error(
                ("expected rows of " + std::to_string(sizeof...(Fields))).c_str());
        std::size_t field = 0;
        rows.push_back(Row{nb::cast<Fields>(row[field++])...});
    }
    return rows;
}

}  // namespace

std::vector<DiscreteRow> discrete_rows(const nb::sequence& encoded) {
    return rows_of<DiscreteRow, std::size_t, const char*, const char*, std::size_t, std::size_t,
                   double, std::size_t, std::int64_t>(encoded);
}

std::vector<FormulaRow> formula_rows(const nb::sequence& encoded) {
    using Bound = std::optional<std::int64_t>;
    return rows_of<FormulaRow, const char*, const char*, std::size_t, std::size_t, Bound, Bound,
                   bool, bool>(encoded);
}

std::vector<DenseRow> dense_rows(const nb::sequence& encoded) {
    using Bound = std::optional<dense::Time>;
    return rows_of<DenseRow, const char*, const char*, std::size_t, std::size_t, double, Bound,
                   Bound>(encoded);
}

std::vector<dense::RegionConstant> region_constants(const nb::sequence& encoded) {
    return rows_of<dense::RegionConstant, std::size_t, double>(encoded);
}

std::vector<std::size_t> registers_of(const nb::sequence& numbers) {
    std::vector<std::size_t> registers;
    for (nb::handle number : numbers) registers.push_back(nb::cast<std::size_t>(number));
    return registers;
}

std::vector<DenseRow> dense_terms(const nb::sequence& encoded) {
    std::vector<DenseRow> rows;
    for (DiscreteRow& row : discrete_rows(encoded))
        rows.push_back({row.kind, row.name, row.a, row.b, row.value, {}, {}});
    return rows;
}

std::vector<double> numbers_of(const nb::sequence& given) {
    std::vector<double> numbers;
    for (nb::handle number : given) numbers.push_back(nb::cast<double>(number));
    return numbers;
}

End end_of(const std::string& name) {
    if (name == "complete") return End::complete;
    if (name == "cut") return End::cut;
    if (name == "open") return End::open;
    throw nb::value_error("expected end='complete', 'cut' or 'open'");
}

}  // namespace rtamt
