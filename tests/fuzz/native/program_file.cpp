// Program files of units that nobody exported: they are refused, or their units can be used.
//
// The bytes are a file without its last line, which has the hash of the others: with it, only files
// that are whole would be read. Behind a zero byte are the inputs of the steps.
#include <algorithm>
#include <cstdio>
#include <exception>
#include <string>
#include <string_view>
#include <utility>

#include "bytes.hpp"
#include "fmu/instance.hpp"

namespace {

using rtamt::fmu::Instance;
using rtamt::fmu::kFirst;
using rtamt::fmu::Program;

// Programs of strangers may ask for as much memory as they like, which is not what is tested here.
constexpr std::size_t kLongest = 1U << 14;

void use(Program program, fuzz::Bytes bytes) {
    const std::size_t inputs = program.inputs.size();
    const double size = program.period > 0 ? program.period : 0.5;
    Instance instance(std::move(program));
    instance.set_times(0.0, 1e6);
    instance.begin_initialization();
    instance.end_initialization();
    for (int i = 0; i < 24; ++i) {
        for (std::size_t k = 0; k < inputs; ++k) {
            const double value = bytes.number();
            instance.settable(static_cast<rtamt::fmu::Reference>(kFirst + k), value) = value;
        }
        instance.step(instance.time(), size);
        for (const auto reference : {rtamt::fmu::kRobustness, rtamt::fmu::kLower, rtamt::fmu::kUpper})
            instance.real(reference);
        if (i % 8 == 7) {
            const std::string state = instance.state();
            instance.restore(state);
            if (instance.state() != state) __builtin_trap();
        }
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    if (size > kLongest) return -1;
    const std::string_view all(reinterpret_cast<const char*>(data), size);
    const std::size_t zero = std::min(all.find('\0'), size);
    std::string file(all.substr(0, zero));
    char last[32];
    std::snprintf(last, sizeof last, "end %016llx\n",
                  static_cast<unsigned long long>(fuzz::hash_of(file)));
    file += last;
    try {
        use(rtamt::fmu::parse_program(file), fuzz::Bytes(data + zero, size - zero));
    } catch (const std::exception&) {  // refused
    }
    return 0;
}
