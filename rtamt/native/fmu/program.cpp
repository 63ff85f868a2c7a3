#include "fmu/program.hpp"

#include <charconv>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string_view>
#include <utility>

#include "core/folds.hpp"
#include "core/functions.hpp"
#include "core/snapshot.hpp"

namespace rtamt::fmu {
namespace {

constexpr const char* kFile = "program.rtamt";
constexpr std::int64_t kMaxBound = std::int64_t{1} << 31;  // of a window, in samples
constexpr std::size_t kMaxRegisters = std::size_t{1} << 24;

double (*function_of(std::string_view name))(double, double) {
#define RTAMT_NAMED(name_, arity, value) \
    if (name == #name_) return functions::name_;
    RTAMT_FUNCTIONS(RTAMT_NAMED)
#undef RTAMT_NAMED
    return nullptr;
}

// Whether the operands are as many as the instruction has; a second that it lacks is the first.
bool fits(const std::string& kind, const std::string& name, std::size_t a, std::size_t b) {
    if (kind != "WINDOW") return true;
#define RTAMT_NAMED(name_, Type) \
    if (name == #name_) return Type::width > 1 || a == b;
    RTAMT_FOLDS(RTAMT_NAMED)
#undef RTAMT_NAMED
    return false;
}

// The fields of one line behind its first word.
class Line {
public:
    Line(std::string_view text, std::size_t number) : rest_(text), number_(number) {}

    bool empty() const { return rest_.empty(); }

    std::string word() {
        if (empty()) refuse("another field");
        const std::size_t end = rest_.find(' ');
        const std::string_view word = rest_.substr(0, end);
        rest_.remove_prefix(end == std::string_view::npos ? rest_.size() : end + 1);
        return std::string(word);
    }
    std::string name() {
        std::string name = word();
        return name == "-" ? std::string() : name;
    }
    template <class T>
    T number() {
        const std::string text = word();
        T value{};
        const char* end = text.data() + text.size();
        const auto [stop, error] = std::from_chars(text.data(), end, value);
        if (error != std::errc() || stop != end) refuse("a number", text);
        return value;
    }
    std::size_t index() {
        const auto value = number<std::size_t>();
        if (value > kMaxRegisters) refuse("a register", std::to_string(value));
        return value;
    }
    std::optional<std::size_t> optional_index() {
        if (!dash()) return index();
        return std::nullopt;
    }
    std::vector<std::size_t> indices() {
        std::vector<std::size_t> all;
        while (!empty()) all.push_back(index());
        return all;
    }
    bool flag() { return number<int>() != 0; }
    std::optional<std::int64_t> bound() {
        if (!dash()) return number<std::int64_t>();
        return std::nullopt;
    }
    // A number of a program with these parameters and derived numbers.
    Number value(const Program& program) {
        const char mark = rest_.empty() ? ' ' : rest_.front();
        if (mark != '%' && mark != '$') return {number<double>(), std::nullopt};
        rest_.remove_prefix(1);
        const std::size_t parameters = program.parameters.size();
        const std::size_t size = mark == '%' ? parameters : program.derived.size();
        const std::size_t i = index();
        if (i >= size) refuse("a number that is known here", mark + std::to_string(i));
        return {0.0, mark == '%' ? i : parameters + i};
    }
    void end() {
        if (!empty()) refuse("the end of the line", rest_);
    }
    [[noreturn]] void refuse(const std::string& expected, std::string_view got = {}) const {
        std::string text = std::string(kFile) + ", line " + std::to_string(number_);
        text += ": expected " + expected;
        if (!got.empty()) text += ", got '" + std::string(got.substr(0, 40)) + "'";
        throw Refusal(text + "; export the unit again");
    }

private:
    // Takes a field that is absent.
    bool dash() {
        const bool absent = rest_.substr(0, 2) == "-" || rest_.substr(0, 2) == "- ";
        if (absent) word();
        return absent;
    }

    std::string_view rest_;
    std::size_t number_;
};

class Reader {
public:
    Program read(std::string_view text) {
        std::size_t number = 0;
        while (!text.empty()) {
            const std::size_t end = text.find('\n');
            Line line(text.substr(0, end), ++number);
            text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
            const std::string kind = line.word();
            if (number == 1 && kind != "rtamt-program") line.refuse("a program of rtamt", kind);
            record(kind, line);
            line.end();
        }
        check(Line({}, number));
        return std::move(program_);
    }

private:
    void record(const std::string& kind, Line& line) {
        if (kind == "rtamt-program") {
            const std::string version = line.word();
            if (version != "3") line.refuse("version 3 of the format", version);
        } else if (kind == "token") {
            program_.token = line.word();
        } else if (kind == "samples") {
            const auto numerator = line.number<double>();
            program_.period = numerator / line.number<double>();
            if (!(program_.period > 0 && std::isfinite(program_.period))) line.refuse("a period");
        } else if (kind == "ticks") {
            ticks(line);
        } else if (kind == "input") {
            program_.inputs.push_back(named(line));
        } else if (kind == "parameter") {
            if (!program_.derived.empty()) line.refuse("parameters before derived numbers");
            program_.parameters.push_back(named(line));
        } else if (kind == "fixed") {
            program_.fixed.push_back(named(line));
        } else if (kind == "formula") {
            std::string name = line.word();
            const auto episode = line.optional_index();
            program_.formulas.push_back({std::move(name), episode, observed_});
            observed_ += !episode;
        } else if (kind == "stop") {
            program_.stop = line.word() == "1";
        } else if (kind == "derived") {
            const std::string name = line.word();
            const auto function = function_of(name);
            if (function == nullptr) line.refuse("a function", name);
            const Number a = line.value(program_);
            program_.derived.push_back({function, a, line.value(program_)});
        } else {
            row(kind, line);
        }
    }

    void ticks(Line& line) {
        const auto scale = line.number<double>();
        const auto counted = line.number<std::int64_t>();
        const auto units = line.number<std::int64_t>();
        if (!(scale > 0 && std::isfinite(scale) && counted >= 0 && units > 0))
            line.refuse("a clock that counts");
        program_.clock = Clock(scale, counted, units);
    }

    void row(const std::string& kind, Line& line) {
        EpisodeProgram* const episode = !program_.regions.empty()    ? &program_.regions.back()
                                        : !program_.episodes.empty() ? &program_.episodes.back()
                                                                     : nullptr;
        if (kind == "episodes" && program_.readings == 0) {
            program_.readings = line.index();
        } else if (kind == "episode") {
            program_.episodes.emplace_back();
        } else if (kind == "monitor" && !program_.monitor) {
            program_.monitor.emplace().terms = line.index();
        } else if (kind == "regions") {
            program_.regions.emplace_back().reach = line.number<dense::Time>();
        } else if (kind == "dense" && !program_.dense) {
            program_.dense.emplace().terms = line.index();
        } else if (kind == "sample-row" && (program_.monitor || episode)) {
            sample_row(program_.monitor ? program_.monitor->rows : episode->terms, line);
        } else if (kind == "region-row" && !program_.regions.empty()) {
            episode->formulas.push_back(formula_row(line));
        } else if (kind == "formula-row" && !program_.episodes.empty()) {
            const FormulaRow row = formula_row(line);
            const std::int64_t lo = row.lo.value_or(-kMaxBound), hi = row.hi.value_or(kMaxBound);
            const bool one_way = (row.hi && hi <= 0) || (row.lo && lo >= 0);
            if (row.kind == "WINDOW" &&
                !(one_way && -kMaxBound <= lo && lo <= hi && hi <= kMaxBound))
                line.refuse("a window in samples");
            program_.episodes.back().formulas.push_back(row);
        } else if (kind == "initial" && episode) {
            episode->initial = line.indices();
        } else if (kind == "streams" && episode) {
            episode->streams = line.indices();
        } else if (kind == "unknowns" && !program_.regions.empty()) {
            episode->unknowns = line.indices();
        } else if (kind == "observed" && program_.monitor) {
            const std::size_t slot = line.index();
            program_.monitor->observed.push_back({slot, line.number<std::int64_t>()});
        } else if (kind == "observed" && program_.dense) {
            program_.dense->observed.push_back(line.index());
        } else if (kind == "dense-row" && program_.dense) {
            dense_row(program_.dense->rows, line);
        } else {
            line.refuse("a record that fits here", kind);
        }
    }

    // Reads the fields that every row has.
    template <class Row>
    static void begin_row(Row& row, Line& line) {
        row.kind = line.name();
        row.name = line.name();
        row.a = line.index();
        row.b = line.index();
    }
    template <class Row>
    static void require_fit(const Row& row, const Line& line, bool in_place = true) {
        if (!in_place || !fits(row.kind, row.name, row.a, row.b)) line.refuse("an instruction");
    }

    void sample_row(Rows<DiscreteRow>& rows, Line& line) {
        DiscreteRow row{};
        row.slot = line.index();
        begin_row(row, line);
        rows.values.push_back(line.value(program_));
        row.value = rows.values.back().literal;
        row.length = line.number<std::size_t>();
        row.start = line.number<std::int64_t>();
        require_fit(row, line, program_.monitor || row.slot == rows.rows.size());
        if (std::uint64_t{row.length} > std::uint64_t{kMaxBound} * 2 || row.start < 0 ||
            row.start > 2 * kMaxBound)
            line.refuse("a window in samples");
        rows.rows.push_back(std::move(row));
    }

    static FormulaRow formula_row(Line& line) {
        FormulaRow row{};
        begin_row(row, line);
        row.lo = line.bound();
        row.hi = line.bound();
        row.guard = line.flag();
        row.endless = line.flag();
        require_fit(row, line);
        return row;
    }

    void dense_row(Rows<DenseRow>& rows, Line& line) {
        DenseRow row{};
        begin_row(row, line);
        rows.values.push_back(line.value(program_));
        row.value = rows.values.back().literal;
        row.lo = line.bound();
        row.hi = line.bound();
        require_fit(row, line);
        rows.rows.push_back(std::move(row));
    }

    static Named named(Line& line) {
        std::string name = line.word();
        return {std::move(name), line.number<double>()};
    }

    void check(const Line& last) const {
        const std::size_t readings = program_.readings;
        const std::size_t episodes = program_.episodes.size(), regions = program_.regions.size();
        const bool counted = readings == 1 || readings == 2;
        const bool samples = program_.period > 0 && !program_.clock && regions == 0 &&
                             readings <= episodes && !program_.dense;
        const bool dense = program_.period == 0 && program_.clock && episodes == 0 &&
                           readings <= regions && !program_.monitor;
        const std::size_t judged = samples ? episodes : regions - readings + 1;
        const std::size_t observed = program_.monitor ? program_.monitor->observed.size()
                                     : program_.dense ? program_.dense->observed.size()
                                                      : 0;
        if (program_.token.empty() || !counted || samples == dense)
            last.refuse("a token and programs");
        bool known = observed == observed_;
        for (const NamedFormula& each : program_.formulas)
            known &= !each.episode || *each.episode < judged;
        if (!known) last.refuse("a register or an episode for each named formula");
    }

    Program program_;
    std::size_t observed_ = 0;  // named formulas that are observed registers
};

// The text before the last line, which says the hash of it.
std::pair<std::string_view, std::uint64_t> whole(std::string_view text) {
    constexpr std::size_t kLast = 4 + 16 + 1;  // "end ", digits, line end
    std::uint64_t said = 0;
    if (text.size() > kLast) {
        const std::string_view last = text.substr(text.size() - kLast);
        const char* digits = last.data() + 4;
        const auto [stop, error] = std::from_chars(digits, digits + 16, said, 16);
        const std::string_view before = text.substr(0, text.size() - kLast);
        Fingerprint print;
        for (const char c : before) print.add(c);
        if (last.substr(0, 4) == "end " && last.back() == '\n' && error == std::errc() &&
            stop == digits + 16 && print.value() == said)
            return {before, said};
    }
    throw Refusal(std::string(kFile) + " is damaged; export the unit again");
}

}  // namespace

std::string number_text(double number) {
    char text[32];
    return {text, std::to_chars(text, text + sizeof text, number).ptr};
}

std::vector<double> Program::numbers(const std::vector<double>& given) const {
    std::vector<double> numbers = given;
    const auto value = [&](const Number& n) { return n.index ? numbers[*n.index] : n.literal; };
    for (const Derived& each : derived) {
        numbers.push_back(each.function(value(each.a), value(each.b)));
        if (!std::isnan(numbers.back())) continue;
        std::string text = "with these parameters a constant of the specification is not a number:";
        for (std::size_t i = 0; i < parameters.size(); ++i) {
            text += " " + parameters[i].name + "=" + number_text(given[i]);
        }
        throw Refusal(text);
    }
    return numbers;
}

Program parse_program(std::string_view bytes) {
    const auto [before, hash] = whole(bytes);
    Program program = Reader().read(before);
    program.fingerprint = hash;
    return program;
}

Program read_program(const std::string& folder) {
    const std::string path = folder + (folder.empty() || folder.back() == '/' ? "" : "/") + kFile;
    const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"),
                                                               std::fclose);
    if (!file) throw Refusal("expected the file " + path + ", which cannot be read");
    std::string bytes;
    char block[1 << 14];
    while (const std::size_t size = std::fread(block, 1, sizeof block, file.get()))
        bytes.append(block, size);
    return parse_program(bytes);
}

}  // namespace rtamt::fmu
