// Functions of Python on whole columns: terms, their ranges, and folds of pairs.
#include <nanobind/nanobind.h>

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "dense/terms.hpp"
#include "discrete/ranges.hpp"
#include "python/arrays.hpp"
#include "python/encoding.hpp"
#include "python/object.hpp"

namespace rtamt {
namespace {

nb::tuple term_columns(const nb::sequence& rows, const nb::sequence& columns) {
    const std::size_t variables = nb::len(columns);
    const dense::TermColumns terms(discrete_rows(rows), variables);
    const std::size_t n = variables == 0 ? 0 : nb::len(nb::object(columns[0]));
    const Arrays arrays(variables, terms.size(), columns, n);
    const std::size_t fine = terms.compute(arrays.sources(), arrays.targets(), n);
    return nb::make_tuple(arrays.made(), fine);
}

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

nb::object fold_pairs(const nb::object& held, const nb::object& reached, std::int64_t before,
                      bool is_max, bool backwards) {
    static const NewArray array("int64");
    const std::size_t n = nb::len(held);
    const auto contiguous = nb::module_::import_("numpy").attr("ascontiguousarray");
    const ArrayView first(contiguous(held, "int64"), n, PyBUF_ND);
    const ArrayView second(contiguous(reached, "int64"), n, PyBUF_ND);
    const auto* p = first.data<std::int64_t>();
    const auto* q = second.data<std::int64_t>();
    std::int64_t* out = nullptr;
    nb::object made = array.unfilled<std::int64_t>(n, out);
    const auto fold = [=](auto combine) {
        std::int64_t last = before;
        for (std::size_t k = 0; k < n; ++k) {
            const std::size_t i = backwards ? n - 1 - k : k;
            out[i] = last = combine(p[i], q[i], last);
        }
    };
    using Key = std::int64_t;
    if (is_max) {
        fold([](Key a, Key b, Key last) { return std::max(b, std::min(a, last)); });
    } else {
        fold([](Key a, Key b, Key last) { return std::min(b, std::max(a, last)); });
    }
    return made;
}

nb::tuple negative_runs(const nb::object& signs, const nb::object& values) {
    using Key = std::int64_t;
    static const NewArray array("int64");
    const std::size_t n = nb::len(signs);
    const auto contiguous = nb::module_::import_("numpy").attr("ascontiguousarray");
    const ArrayView first_view(contiguous(signs, "int64"), n, PyBUF_ND);
    const ArrayView second_view(contiguous(values, "int64"), n, PyBUF_ND);
    const auto* sign = first_view.data<Key>();
    const auto* value = second_view.data<Key>();
    std::size_t runs = n > 0 && sign[0] < 0;
    for (std::size_t i = 1; i < n; ++i) runs += (sign[i] < 0) & (sign[i - 1] >= 0);
    Key *first = nullptr, *after = nullptr, *least = nullptr, *place = nullptr;
    const nb::tuple made =
        nb::make_tuple(array.unfilled<Key>(runs, first), array.unfilled<Key>(runs, after),
                       array.unfilled<Key>(runs, least), array.unfilled<Key>(runs, place));
    std::size_t i = 0;
    for (std::size_t run = 0; run < runs; ++run) {
        while (sign[i] >= 0) ++i;
        std::size_t worst = i;
        first[run] = static_cast<Key>(i);
        for (++i; i < n && sign[i] < 0; ++i)
            if (value[i] < value[worst]) worst = i;
        after[run] = static_cast<Key>(i);
        least[run] = value[worst];
        place[run] = static_cast<Key>(worst);
    }
    return made;
}

}  // namespace

void bind_columns(nb::module_& m) {
    m.def("term_columns", term_columns, nb::arg("rows"), nb::arg("columns"),
          "Return a column for each term from one for each variable, and the number of samples\n"
          "before the first at which a term is nan; see rtamt.machines.terms.term_columns.");
    m.def("term_ranges", term_ranges, nb::arg("rows"), nb::arg("variables"), nb::arg("observed"),
          nb::arg("reader"), nb::arg("lower"), nb::arg("upper"), nb::arg("n"),
          "Return the least and the greatest values of observed terms at n samples, as\n"
          "rtamt.machines.terms.term_ranges says.");
    m.def("fold_pairs", fold_pairs, nb::arg("p"), nb::arg("q"), nb::arg("before"),
          nb::arg("is_max"), nb::arg("backwards"),
          "Return max(q, min(p, before)) of each pair, as rtamt.machines.walk.FoldPairs says.");
    m.def("negative_runs", negative_runs, nb::arg("signs"), nb::arg("values"),
          "Return the runs of negative integers, as rtamt.machines.segments.FindRuns says.");
}

}  // namespace rtamt
