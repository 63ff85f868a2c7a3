// What several batches of episodes find together, entry by entry. The definitions are in
// rtamt/machines/batch.py.
#include <nanobind/nanobind.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "batch/variants.hpp"
#include "core/columns.hpp"
#include "python/arrays.hpp"
#include "python/encoding.hpp"
#include "python/object.hpp"

namespace rtamt {
namespace {

using EpisodeObject = Object<BatchVariants>;
using Batches = std::vector<EpisodeObject*>;

// The batches of a tuple, one or more, all of as many entries.
Batches batches_of(const nb::tuple& objects) {
    Batches batches;
    for (nb::handle object : objects) {
        batches.push_back(&nb::cast<EpisodeObject&>(object));
        if (batches.back()->machine.num() != batches.front()->machine.num())
            throw nb::value_error("expected batches of as many entries");
    }
    if (batches.empty()) throw nb::value_error("expected a batch, got none");
    return batches;
}

// The elements of a contiguous array of so many; they stay where they are while the array exists.
template <class T>
T* elements_of(nb::handle array, std::size_t n) {
    void* found = Numpy::instance().elements<T>(array.ptr(), n);
    if (found == nullptr) throw nb::value_error("expected contiguous arrays of the batches' shape");
    return static_cast<T*>(found);
}

const std::uint8_t* mask_of(nb::handle mask, std::size_t num) {
    if (mask.is_none()) return nullptr;
    return elements_of<std::uint8_t>(mask, num);
}

// The least of the values and of what is there before; -0.0 stands for a value that is `over`.
RTAMT_LOOP void fold_least(const double* values, const std::uint8_t* over, bool first, double* out,
                           std::size_t num) {
    if (first && over == nullptr) {
        std::copy_n(values, num, out);
        return;
    }
    RTAMT_INDEPENDENT
    for (std::size_t entry = 0; entry < num; ++entry) {
        const double x = over != nullptr && over[entry] ? -0.0 : values[entry];
        const double before = first ? x : out[entry];
        // An entry without samples has no robustness by any specification.
        const double known = before != before ? before : lesser(before, x);
        out[entry] = x != x ? x : known;
    }
}

nb::object least(const nb::tuple& objects, const std::string& name, nb::handle failed) {
    const Batches batches = batches_of(objects);
    const std::size_t num = batches.front()->machine.num();
    double* out = nullptr;
    const std::uint8_t* ended =
        failed.is_none() ? nullptr : elements_of<std::uint8_t>(failed, batches.size() * num);
    static const NewArray doubles("float64");
    nb::object array = doubles.unfilled<double>(num, out);
    for (std::size_t k = 0; k < batches.size(); ++k) {
        const BatchVariants& batch = batches[k]->machine;
        const double* values = name == "robustness" ? batch.results()
                               : name == "lower"    ? batch.lower()
                                                    : batch.upper();
        const std::uint8_t* over = ended == nullptr ? nullptr : ended + k * num;
        widest<fold_least>(values, over, k == 0, out, num);
    }
    return array;
}

// Whether an entry of the mask has a flag.
RTAMT_LOOP void find_both(const std::uint8_t* flags, const std::uint8_t* mask, std::size_t num,
                          bool* found) {
    std::uint8_t any = 0;
    if (mask == nullptr)
        for (std::size_t entry = 0; entry < num; ++entry) any |= flags[entry];
    else
        for (std::size_t entry = 0; entry < num; ++entry)
            any |= mask[entry] != 0 ? flags[entry] : 0;
    *found = any != 0;
}

// Feeds every batch its columns of a table. Returns the first batch that has to read its samples by
// itself, or how many batches there are.
std::size_t feed(const nb::tuple& objects, const nb::tuple& columns, nb::handle table,
                 nb::handle mask) {
    const Batches batches = batches_of(objects);
    const std::size_t num = batches.front()->machine.num();
    if (nb::len(columns) != batches.size())
        throw nb::value_error("expected columns for every batch");
    const std::uint8_t* chosen = nullptr;
    if (!mask.is_none()) {
        chosen = static_cast<const std::uint8_t*>(
            Numpy::instance().elements<std::uint8_t>(mask.ptr(), num));
        if (chosen == nullptr) return 0;
    }
    std::size_t width = 0;
    Table all = Numpy::instance().table(table.ptr(), static_cast<Py_ssize_t>(num), width);
    if (all.data == nullptr) return 0;
    std::vector<std::size_t> picked;
    for (std::size_t k = 0; k < batches.size(); ++k) {
        BatchVariants& batch = batches[k]->machine;
        picked.clear();
        for (nb::handle column : nb::cast<nb::tuple>(columns[k]))
            picked.push_back(nb::cast<std::size_t>(column));
        if (picked.size() != batch.variables() ||
            std::any_of(picked.begin(), picked.end(), [=](std::size_t at) { return at >= width; }))
            throw nb::value_error("expected a column of the table for every variable");
        bool over = false;
        widest<find_both>(batch.finished(), chosen, num, &over);
        if (over) return k;
        all.picked = picked.data();
        if (batch.take(all, chosen) < num) return k;
    }
    return batches.size();
}

// Ends the traces of the entries of the mask; false, and nothing is done, if one has no sample.
bool finish(const nb::tuple& objects, nb::handle mask, const std::string& end) {
    const Batches batches = batches_of(objects);
    const std::size_t num = batches.front()->machine.num();
    const End reading = end_of(end);
    const std::uint8_t* chosen = mask_of(mask, num);
    for (const EpisodeObject* batch : batches)
        for (std::size_t entry = 0; entry < num; ++entry)
            if ((chosen == nullptr || chosen[entry]) && batch->machine.samples()[entry] == 0)
                return false;
    for (EpisodeObject* batch : batches) batch->machine.finish(chosen, reading);
    return true;
}

// Whether a verdict that was open is decided. Few are: it is found without a branch for each entry.
RTAMT_LOOP void find_new(const std::int64_t* settled_at, const double* lower, const double* upper,
                         const std::uint8_t* failed, std::size_t num, bool* found) {
    std::uint64_t any = 0;
    for (std::size_t entry = 0; entry < num; ++entry) {
        const auto open = static_cast<std::uint64_t>(settled_at[entry]);
        any |= open & (~bits_of(lower[entry]) | bits_of(upper[entry]) |
                       (std::uint64_t{failed[entry]} << 63));
    }
    *found = any >> 63 != 0;
}

int verdict_in(const BatchVariants& batch, std::size_t entry, bool failed) {
    return failed ? -1 : verdict_of(batch.lower()[entry], batch.upper()[entry]);
}

// Writes the verdicts that are new, in entries of the mask, into the verdict log.
void note(const nb::tuple& objects, nb::handle mask, nb::handle settled_at, nb::handle violated,
          nb::handle failed, nb::handle first, nb::handle violated_at) {
    const Batches batches = batches_of(objects);
    const std::size_t num = batches.front()->machine.num();
    auto* decided = elements_of<std::int64_t>(settled_at, batches.size() * num);
    auto* broken = elements_of<std::uint8_t>(violated, batches.size() * num);
    const auto* ended = elements_of<std::uint8_t>(failed, batches.size() * num);
    auto* by = elements_of<std::int64_t>(first, num);
    auto* at = elements_of<std::int64_t>(violated_at, num);
    const std::uint8_t* chosen = mask_of(mask, num);
    for (std::size_t k = 0; k < batches.size(); ++k) {
        const BatchVariants& batch = batches[k]->machine;
        const double* lower = batch.lower();
        const double* upper = batch.upper();
        std::int64_t* row = decided + k * num;
        const std::uint8_t* over = ended + k * num;
        bool any = chosen != nullptr;
        if (!any) widest<find_new>(row, lower, upper, over, num, &any);
        if (!any) continue;
        for (std::size_t entry = 0; entry < num; ++entry) {
            if (chosen != nullptr && !chosen[entry]) continue;
            if (row[entry] >= 0 || batch.samples()[entry] == 0) continue;
            const int verdict = verdict_in(batch, entry, over[entry] != 0);
            if (verdict == 0) continue;
            row[entry] = batch.samples()[entry] - 1;
            if (verdict > 0) continue;
            broken[k * num + entry] = 1;
            if (at[entry] >= 0) continue;
            by[entry] = static_cast<std::int64_t>(k);
            at[entry] = row[entry];
        }
    }
}

// Forgets the entries of the mask in the verdict log.
void forget(nb::handle mask, std::size_t specs, std::size_t num, nb::handle settled_at,
            nb::handle violated, nb::handle failed, nb::handle first, nb::handle violated_at) {
    const std::uint8_t* chosen = mask_of(mask, num);
    auto* decided = elements_of<std::int64_t>(settled_at, specs * num);
    auto* broken = elements_of<std::uint8_t>(violated, specs * num);
    auto* ended = elements_of<std::uint8_t>(failed, specs * num);
    auto* by = elements_of<std::int64_t>(first, num);
    auto* at = elements_of<std::int64_t>(violated_at, num);
    for (std::size_t entry = 0; entry < num; ++entry) {
        if (chosen != nullptr && !chosen[entry]) continue;
        by[entry] = at[entry] = -1;
        for (std::size_t i = entry; i < specs * num; i += num) {
            decided[i] = -1;
            broken[i] = ended[i] = 0;
        }
    }
}

// So many entries, by their numbers, all below num.
struct Chosen {
    Chosen(nb::handle entries, std::size_t num)
        : count(nb::len(entries)), at(elements_of<std::int64_t>(entries, count)) {
        for (std::size_t i = 0; i < count; ++i)
            if (at[i] < 0 || static_cast<std::size_t>(at[i]) >= num)
                throw nb::index_error("expected the numbers of entries");
    }
    std::size_t operator[](std::size_t i) const { return static_cast<std::size_t>(at[i]); }

    std::size_t count;
    const std::int64_t* at;
};

// A new array of so many rows and columns, and its elements.
template <class T>
nb::object grid(const char* dtype, std::size_t rows, std::size_t columns, T*& elements) {
    static PyObject* const empty = permanent(nb::module_::import_("numpy").attr("empty"));
    static PyObject* const type = rtamt::dtype(dtype);  // one for each T
    const nb::object array = new_array(empty, nb::make_tuple(rows, columns), type);
    elements = static_cast<T*>(Numpy::instance().begin(array.ptr()));
    if (elements == nullptr) throw nb::value_error("expected arrays of numpy");
    return array;
}

// The outcomes of these entries, as `BatchOutcomes` in rtamt/machines/batch.py names them.
nb::tuple outcomes(const nb::tuple& objects, nb::handle entries, nb::handle failed,
                   nb::handle settled_at) {
    const Batches batches = batches_of(objects);
    const std::size_t num = batches.front()->machine.num(), specs = batches.size();
    const Chosen chosen(entries, num);
    const auto* ended = elements_of<std::uint8_t>(failed, specs * num);
    const auto* decided = elements_of<std::int64_t>(settled_at, specs * num);
    double* robustness = nullptr;
    std::int8_t* verdicts = nullptr;
    std::int64_t* when = nullptr;
    std::uint8_t *known = nullptr, *satisfied = nullptr, *by_end = nullptr;
    std::uint8_t *success = nullptr, *open = nullptr;
    const nb::object values = grid("float64", specs, chosen.count, robustness);
    const nb::object signs = grid("int8", specs, chosen.count, verdicts);
    const nb::object times = grid("int64", specs, chosen.count, when);
    const nb::object knows = grid("bool", specs, chosen.count, known);
    const nb::object holds = grid("bool", specs, chosen.count, satisfied);
    const nb::object cut = grid("bool", specs, chosen.count, by_end);
    static const NewArray flags("bool");
    const nb::object all = flags.unfilled<std::uint8_t>(chosen.count, success);
    const nb::object some = flags.unfilled<std::uint8_t>(chosen.count, open);
    std::fill(success, success + chosen.count, std::uint8_t{1});
    std::fill(open, open + chosen.count, std::uint8_t{0});
    for (std::size_t k = 0; k < specs; ++k) {
        const BatchVariants& batch = batches[k]->machine;
        for (std::size_t i = 0; i < chosen.count; ++i) {
            const std::size_t entry = chosen[i];
            const bool is = batch.samples()[entry] > 0;
            const double value = is ? batch.results()[entry] : 0.0;
            const int verdict = is ? verdict_in(batch, entry, ended[k * num + entry] != 0) : 0;
            *robustness++ = value;
            *verdicts++ = static_cast<std::int8_t>(verdict);
            *when = decided[k * num + entry];
            *known++ = *when++ >= 0;
            *satisfied++ = verdict > 0;
            *by_end++ = verdict < 0 && !std::signbit(value);
            success[i] &= verdict > 0;
            open[i] |= verdict == 0;
        }
    }
    return nb::make_tuple(values, signs, times, knows, holds, cut, all, some);
}

// Where elements are written that are read from a `Numpy::Rows`.
struct Spread {
    nb::object array;
    void* elements;  // null if their place is not known

    // So many rows of num zeros, or of no objects.
    Spread(const Numpy::Rows& like, PyObject* dtype, std::size_t num) {
        static PyObject* const zeros = permanent(nb::module_::import_("numpy").attr("zeros"));
        static PyObject* const empty = permanent(nb::module_::import_("numpy").attr("empty"));
        const nb::object shape =
            like.single ? nb::object(nb::int_(num)) : nb::object(nb::make_tuple(like.count, num));
        const bool objects = dtype == like.dtype && Numpy::instance().are_objects(like);
        array = new_array(objects ? empty : zeros, shape, dtype);
        elements = Numpy::instance().begin(array.ptr());
    }
};

template <class T>
void scatter(const Numpy::Rows& from, const std::uint8_t* has, const Chosen& entries,
             std::size_t num, void* elements) {
    const T* values = reinterpret_cast<const T*>(from.data);
    T* to = static_cast<T*>(elements);
    for (std::size_t row = 0; row < from.count; ++row, to += num)
        for (std::size_t i = 0; i < entries.count; ++i, ++values)
            if (has == nullptr || has[row * entries.count + i]) to[entries[i]] = *values;
}

// Objects are counted; numpy writes no object as null, or as None.
void scatter_objects(const Numpy::Rows& from, const std::uint8_t* has, const Chosen& entries,
                     std::size_t num, void* elements) {
    auto* const* values = reinterpret_cast<PyObject* const*>(from.data);
    auto** to = static_cast<PyObject**>(elements);
    for (std::size_t row = 0; row < from.count; ++row, to += num)
        for (std::size_t i = 0; i < entries.count; ++i, ++values) {
            if ((has != nullptr && !has[row * entries.count + i]) || *values == nullptr) continue;
            Py_INCREF(*values);
            Py_XSETREF(to[entries[i]], *values);
        }
}

void set_item(nb::handle place, nb::handle key, nb::handle value) {
    if (PyDict_SetItem(place.ptr(), key.ptr(), value.ptr()) != 0) nb::raise_python_error();
}

// Writes an array of all entries, and its mask, under two keys of a dictionary, or of one for each
// row; no row without an element. False, and nothing is written, if the value or what says which
// elements there are is no contiguous array of doubles, 64-bit integers, bools or objects.
bool spread_one(const nb::tuple& column, const Chosen& entries, std::size_t num) {
    const Numpy& numpy = Numpy::instance();
    const nb::object place = column[0], key = column[1], mask_key = column[2];
    const nb::object value = column[3], there = column[4];
    const Numpy::Rows from = numpy.rows(value.ptr(), entries.count);
    if (from.data == nullptr) return false;
    const std::uint8_t* has = nullptr;
    if (!there.is_none()) {
        has = static_cast<const std::uint8_t*>(
            numpy.elements<std::uint8_t>(there.ptr(), from.count * entries.count));
        if (has == nullptr) return false;
    }
    if (from.single != PyDict_Check(place.ptr())) return false;
    if (!from.single && nb::len(place) != from.count) return false;
    const auto some = [&](std::size_t row) {
        if (has == nullptr) return entries.count > 0;
        const std::uint8_t* begin = has + row * entries.count;
        return std::any_of(begin, begin + entries.count, [](std::uint8_t is) { return is != 0; });
    };
    bool any = false;
    for (std::size_t row = 0; row < from.count; ++row) any = any || some(row);
    if (!any) return true;
    const Spread held(from, from.dtype, num), mask(from, numpy.bools(), num);
    if (held.elements == nullptr || mask.elements == nullptr) return false;
    if (numpy.are_objects(from))
        scatter_objects(from, has, entries, num, held.elements);
    else if (from.size == 1)
        scatter<std::uint8_t>(from, has, entries, num, held.elements);
    else
        scatter<std::uint64_t>(from, has, entries, num, held.elements);  // the bits of a number
    auto* mark = static_cast<std::uint8_t*>(mask.elements);
    for (std::size_t row = 0; row < from.count; ++row, mark += num)
        for (std::size_t i = 0; i < entries.count; ++i)
            mark[entries[i]] = has == nullptr || has[row * entries.count + i];
    if (from.single) {
        set_item(place, key, held.array);
        set_item(place, mask_key, mask.array);
        return true;
    }
    for (std::size_t row = 0; row < from.count; ++row) {
        if (!some(row)) continue;
        const nb::object group = place[row];
        set_item(group, key, held.array[row]);
        set_item(group, mask_key, mask.array[row]);
    }
    return true;
}

// Spreads columns until one that it cannot; returns how many.
std::size_t spread(const nb::list& columns, nb::handle entries, std::size_t num) {
    const Chosen chosen(entries, num);
    std::size_t done = 0;
    for (nb::handle column : columns) {
        if (!spread_one(nb::cast<nb::tuple>(column), chosen, num)) break;
        ++done;
    }
    return done;
}

// Resets the entries of the mask in every batch.
void reset_all(const nb::tuple& objects, nb::handle mask) {
    const Batches batches = batches_of(objects);
    const std::uint8_t* chosen = mask_of(mask, batches.front()->machine.num());
    for (EpisodeObject* batch : batches) {
        require_idle(*batch);
        batch->machine.reset(chosen);
    }
}

}  // namespace

void bind_verdict_logs(nb::module_& m) {
    m.def(
        "feed_batches", feed, "batches"_a, "columns"_a, "table"_a, "mask"_a.none(),
        "Feed every batch its columns of a table; return the first that has to read them itself.");
    m.def("least_of_batches", least, "batches"_a, "name"_a, "failed"_a.none(),
          "The least robustness, or bound, over the batches, of every entry.");
    m.def("finish_batches", finish, "batches"_a, "mask"_a.none(), "end"_a,
          "End the episodes of the entries; false, and nothing is done, if one has no sample.");
    m.def("note_verdicts", note, "batches"_a, "mask"_a.none(), "settled_at"_a, "violated"_a,
          "failed"_a, "first"_a, "violated_at"_a, "Write the verdicts that are new into a log.");
    m.def("forget_verdicts", forget, "mask"_a.none(), "specs"_a, "num"_a, "settled_at"_a,
          "violated"_a, "failed"_a, "first"_a, "violated_at"_a,
          "Forget the entries of the mask in a log.");
    m.def("outcomes_of_batches", outcomes, "batches"_a, "entries"_a, "failed"_a, "settled_at"_a,
          "The outcomes of these entries.");
    m.def("spread_entries", spread, "columns"_a, "entries"_a, "num"_a,
          "Write arrays of all entries into dictionaries; return how many columns were written.");
    m.def("reset_batches", reset_all, "batches"_a, "mask"_a.none(),
          "Forget the entries of the mask.");
}

}  // namespace rtamt
