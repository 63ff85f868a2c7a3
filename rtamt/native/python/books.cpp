// What several banks of episodes find together, lane by lane. The definitions are in
// rtamt/machines/books.py.
#include <nanobind/nanobind.h>

#include <algorithm>
#include <string>
#include <vector>

#include "lockstep/uncertain.hpp"
#include "python/arrays.hpp"
#include "python/encoding.hpp"
#include "python/object.hpp"

namespace rtamt {
namespace {

using EpisodeObject = Object<UncertainBank>;
using Banks = std::vector<EpisodeObject*>;

// The banks of a tuple, one or more, all of as many lanes.
Banks banks_of(const nb::tuple& objects) {
    Banks banks;
    for (nb::handle object : objects) {
        banks.push_back(&nb::cast<EpisodeObject&>(object));
        if (banks.back()->machine.num() != banks.front()->machine.num())
            throw nb::value_error("expected banks of as many lanes");
    }
    if (banks.empty()) throw nb::value_error("expected a bank, got none");
    return banks;
}

// The elements of a contiguous array of so many; they stay where they are while the array exists.
template <class T>
T* elements_of(nb::handle array, std::size_t n) {
    void* found = Numpy::instance().elements<T>(array.ptr(), n);
    if (found == nullptr) throw nb::value_error("expected contiguous arrays of the banks' shape");
    return static_cast<T*>(found);
}

const std::uint8_t* mask_of(nb::handle mask, std::size_t num) {
    if (mask.is_none()) return nullptr;
    return elements_of<std::uint8_t>(mask, num);
}

nb::object new_doubles(std::size_t n, double*& out) {
    static const NewArray array("float64");
    return array.unfilled<double>(n, out);
}

nb::object least(const nb::tuple& objects, const std::string& name, nb::handle failed) {
    const Banks banks = banks_of(objects);
    const std::size_t num = banks.front()->machine.num();
    double* out = nullptr;
    const std::uint8_t* ended =
        failed.is_none() ? nullptr : elements_of<std::uint8_t>(failed, banks.size() * num);
    nb::object array = new_doubles(num, out);
    for (std::size_t k = 0; k < banks.size(); ++k) {
        const UncertainBank& bank = banks[k]->machine;
        const double* values = name == "robustness" ? bank.results()
                               : name == "lower"    ? bank.lower()
                                                    : bank.upper();
        for (std::size_t lane = 0; lane < num; ++lane) {
            const double x = ended != nullptr && ended[k * num + lane] ? -0.0 : values[lane];
            const double before = k == 0 ? x : out[lane];
            // A lane without samples has no robustness by any specification.
            out[lane] = before != before ? before : x != x ? x : lesser(before, x);
        }
    }
    return array;
}

// Feeds every bank its columns of a table. Returns the first bank that has to read its samples by
// itself, or how many banks there are.
std::size_t feed(const nb::tuple& objects, const nb::tuple& columns, nb::handle table,
                 nb::handle mask) {
    const Banks banks = banks_of(objects);
    const std::size_t num = banks.front()->machine.num();
    if (nb::len(columns) != banks.size())
        throw nb::value_error("expected columns for every bank");
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
    for (std::size_t k = 0; k < banks.size(); ++k) {
        UncertainBank& bank = banks[k]->machine;
        picked.clear();
        for (nb::handle column : nb::cast<nb::tuple>(columns[k]))
            picked.push_back(nb::cast<std::size_t>(column));
        if (picked.size() != bank.variables() ||
            std::any_of(picked.begin(), picked.end(), [=](std::size_t at) { return at >= width; }))
            throw nb::value_error("expected a column of the table for every variable");
        for (std::size_t lane = 0; lane < num; ++lane)
            if ((chosen == nullptr || chosen[lane]) && bank.finished()[lane]) return k;
        all.picked = picked.data();
        if (bank.take(all, chosen) < num) return k;
    }
    return banks.size();
}

// Ends the traces of the lanes of the mask; false, and nothing is done, if one has no sample.
bool finish(const nb::tuple& objects, nb::handle mask, const std::string& end) {
    const Banks banks = banks_of(objects);
    const std::size_t num = banks.front()->machine.num();
    const End reading = end_of(end);
    const std::uint8_t* chosen = mask_of(mask, num);
    for (const EpisodeObject* bank : banks)
        for (std::size_t lane = 0; lane < num; ++lane)
            if ((chosen == nullptr || chosen[lane]) && bank->machine.samples()[lane] == 0)
                return false;
    for (EpisodeObject* bank : banks) bank->machine.finish(chosen, reading);
    return true;
}

int verdict_in(const UncertainBank& bank, std::size_t lane, bool failed) {
    return failed ? -1 : verdict_of(bank.lower()[lane], bank.upper()[lane]);
}

// Writes the verdicts that are new into the book.
void note(const nb::tuple& objects, nb::handle decided_at, nb::handle violated, nb::handle failed,
          nb::handle first, nb::handle violated_at) {
    const Banks banks = banks_of(objects);
    const std::size_t num = banks.front()->machine.num();
    auto* decided = elements_of<std::int64_t>(decided_at, banks.size() * num);
    auto* broken = elements_of<std::uint8_t>(violated, banks.size() * num);
    const auto* ended = elements_of<std::uint8_t>(failed, banks.size() * num);
    auto* by = elements_of<std::int64_t>(first, num);
    auto* at = elements_of<std::int64_t>(violated_at, num);
    for (std::size_t k = 0; k < banks.size(); ++k) {
        const UncertainBank& bank = banks[k]->machine;
        const double* lower = bank.lower();
        const double* upper = bank.upper();
        std::int64_t* row = decided + k * num;
        const std::uint8_t* over = ended + k * num;
        // Few verdicts are new: whether one is, is found without a branch for each lane.
        std::uint64_t any = 0;
        for (std::size_t lane = 0; lane < num; ++lane) {
            const auto open = static_cast<std::uint64_t>(row[lane]);
            any |= open & (~bits_of(lower[lane]) | bits_of(upper[lane]) |
                           (std::uint64_t{over[lane]} << 63));
        }
        if (any >> 63 == 0) continue;
        for (std::size_t lane = 0; lane < num; ++lane) {
            if (row[lane] >= 0 || bank.samples()[lane] == 0) continue;
            const int verdict = verdict_in(bank, lane, over[lane] != 0);
            if (verdict == 0) continue;
            row[lane] = bank.samples()[lane] - 1;
            if (verdict > 0) continue;
            broken[k * num + lane] = 1;
            if (at[lane] >= 0) continue;
            by[lane] = static_cast<std::int64_t>(k);
            at[lane] = row[lane];
        }
    }
}

// Forgets the lanes of the mask in the book.
void forget(nb::handle mask, std::size_t specs, std::size_t num, nb::handle decided_at,
            nb::handle violated, nb::handle failed, nb::handle first, nb::handle violated_at) {
    const std::uint8_t* chosen = mask_of(mask, num);
    auto* decided = elements_of<std::int64_t>(decided_at, specs * num);
    auto* broken = elements_of<std::uint8_t>(violated, specs * num);
    auto* ended = elements_of<std::uint8_t>(failed, specs * num);
    auto* by = elements_of<std::int64_t>(first, num);
    auto* at = elements_of<std::int64_t>(violated_at, num);
    for (std::size_t lane = 0; lane < num; ++lane) {
        if (chosen != nullptr && !chosen[lane]) continue;
        by[lane] = at[lane] = -1;
        for (std::size_t i = lane; i < specs * num; i += num) {
            decided[i] = -1;
            broken[i] = ended[i] = 0;
        }
    }
}

// The outcomes of the lanes of the mask that have samples: the robustness and the verdict of every
// specification; 0 in other lanes.
nb::tuple outcomes(const nb::tuple& objects, nb::handle mask, nb::handle failed) {
    const Banks banks = banks_of(objects);
    const std::size_t num = banks.front()->machine.num();
    const std::uint8_t* chosen = mask_of(mask, num);
    const auto* ended = elements_of<std::uint8_t>(failed, banks.size() * num);
    double* robustness = nullptr;
    std::int8_t* verdicts = nullptr;
    static const NewArray small("int8");
    nb::object values = new_doubles(banks.size() * num, robustness);
    nb::object signs = small.unfilled<std::int8_t>(banks.size() * num, verdicts);
    for (std::size_t k = 0; k < banks.size(); ++k) {
        const UncertainBank& bank = banks[k]->machine;
        for (std::size_t lane = 0; lane < num; ++lane) {
            const std::size_t i = k * num + lane;
            const bool is = (chosen == nullptr || chosen[lane]) && bank.samples()[lane] > 0;
            robustness[i] = is ? bank.results()[lane] : 0.0;
            verdicts[i] = static_cast<std::int8_t>(is ? verdict_in(bank, lane, ended[i] != 0) : 0);
        }
    }
    return nb::make_tuple(values.attr("reshape")(banks.size(), num),
                          signs.attr("reshape")(banks.size(), num));
}

}  // namespace

void bind_books(nb::module_& m) {
    m.def("feed_banks", feed, nb::arg("banks"), nb::arg("columns"), nb::arg("table"),
          nb::arg("mask").none(),
          "Feed every bank its columns of a table; return the first that has to read them itself.");
    m.def("least_of_banks", least, nb::arg("banks"), nb::arg("name"), nb::arg("failed").none(),
          "The least robustness, or bound, over the banks, of every lane.");
    m.def("finish_banks", finish, nb::arg("banks"), nb::arg("mask").none(), nb::arg("end"),
          "End the episodes of the lanes; false, and nothing is done, if one has no sample.");
    m.def("note_verdicts", note, nb::arg("banks"), nb::arg("decided_at"), nb::arg("violated"),
          nb::arg("failed"), nb::arg("first"), nb::arg("violated_at"),
          "Write the verdicts that are new into a book.");
    m.def("forget_verdicts", forget, nb::arg("mask").none(), nb::arg("specs"), nb::arg("num"),
          nb::arg("decided_at"), nb::arg("violated"), nb::arg("failed"), nb::arg("first"),
          nb::arg("violated_at"), "Forget the lanes of the mask in a book.");
    m.def("outcomes_of_banks", outcomes, nb::arg("banks"), nb::arg("mask").none(),
          nb::arg("failed"), "The robustness and the verdicts of the lanes of the mask.");
}

}  // namespace rtamt
