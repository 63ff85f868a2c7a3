// The values that terms can have, as a function of Python. The definition is rtamt/machines/terms.py.
#include "discrete/ranges.hpp"

#include <nanobind/nanobind.h>

#include <utility>
#include <vector>

#include "python/arrays.hpp"
#include "python/encoding.hpp"
#include "python/object.hpp"

namespace rtamt {
namespace {

nb::tuple term_ranges(const nb::sequence& rows, std::size_t variables,
                      const nb::sequence& observed, const nb::object& reader,
                      const nb::sequence& lower, const nb::sequence& upper, std::size_t n) {
    TermRanges ranges(discrete_rows(rows), variables);
    const std::vector<std::size_t> wanted = registers_of(observed);
    for (const std::size_t slot : wanted)
        if (slot >= ranges.terms()) throw nb::value_error("an observed register is no term");
    const Arrays low(variables, wanted.size(), lower, n);
    const Arrays high(variables, wanted.size(), upper, n);
    std::vector<double> least(variables);
    std::vector<double> greatest(variables);
    for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t v = 0; v < variables; ++v) {
            least[v] = low.sources()[v][i];
            greatest[v] = high.sources()[v][i];
        }
        if (!ranges.find(least.data(), greatest.data(), 1))
            refuse(reader, "refuse_between", list_of(least.data(), variables),
                   list_of(greatest.data(), variables), i);
        for (std::size_t k = 0; k < wanted.size(); ++k) {
            low.targets()[k][i] = ranges[wanted[k]].lower;
            high.targets()[k][i] = ranges[wanted[k]].upper;
        }
    }
    return nb::make_tuple(low.made(), high.made());
}

}  // namespace

void bind_ranges(nb::module_& m) {
    m.def("term_ranges", term_ranges, nb::arg("rows"), nb::arg("variables"), nb::arg("observed"),
          nb::arg("reader"), nb::arg("lower"), nb::arg("upper"), nb::arg("n"),
          "Return the least and the greatest values of observed terms at n samples, as\n"
          "rtamt.machines.terms.term_ranges says.");
}

}  // namespace rtamt
