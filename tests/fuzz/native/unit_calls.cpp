// Calls of units in any order, with any arguments, of several instances in several threads.
//
// Two instances are called one after the other, and again in a thread each: what they give must be
// the same, and no call may do more than refuse.
#include <array>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include "bytes.hpp"
#include "units.hpp"

namespace {

using fuzz::Bytes;
using fuzz::Unit;

constexpr std::size_t kSlots = 3;
constexpr std::size_t kMostCalls = 200;

// What the calls gave, and the calls.
class Course {
public:
    explicit Course(Bytes bytes) : bytes_(bytes) {}

    std::string run() {
        const int version = 2 + static_cast<int>(bytes_.below(2));
        Unit unit(version, bytes_.below(std::size(fuzz::kFolders)));
        if (!unit.made()) std::abort();
        for (std::size_t i = 0; i < kMostCalls && !bytes_.empty(); ++i) call(unit);
        return std::move(given_);
    }

private:
    void status(int value) { given_ += static_cast<char>('0' + value); }
    template <class T>
    void value(const T& value) {
        given_.append(reinterpret_cast<const char*>(&value), sizeof value);
    }

    void call(Unit& unit) {
        void*& state = states_[bytes_.below(kSlots)];
        switch (bytes_.below(16)) {
            case 0: {
                time_ = bytes_.number();
                const bool stops = bytes_.below(2) != 0;
                status(unit.enter(time_, stops, bytes_.number()));
                break;
            }
            case 1: status(unit.leave()); break;
            case 2: status(unit.terminate()); break;
            case 3: {
                status(unit.reset());
                time_ = 0.0;
                break;
            }
            case 4: {
                const std::uint32_t reference = bytes_.byte();
                const double number = bytes_.number();
                status(unit.set(&reference, &number, 1));
                break;
            }
            case 5: {
                const std::array<std::uint32_t, 2> inputs = {fuzz::kFirst, fuzz::kFirst + 1};
                const std::array<double, 2> numbers{bytes_.number(), bytes_.number()};
                status(unit.set(inputs.data(), numbers.data(), bytes_.below(2) + 1));
                break;
            }
            case 6: {
                const double size = bytes_.number();
                if (size > 64) break;  // as many samples as anyone likes take as long
                const int done = unit.step(time_, size);
                if (done != fuzz::kError) time_ += size;
                status(done);
                break;
            }
            case 7: status(unit.step(bytes_.number(), 1.0)); break;
            case 8: {
                std::array<double, 3> outputs = {};
                status(unit.get(fuzz::kOutputs, outputs.data(), outputs.size()));
                value(outputs);
                break;
            }
            case 9: {
                const std::uint32_t reference = bytes_.byte();
                double number = 0.0;
                status(unit.get(&reference, &number, 1));
                value(number);
                break;
            }
            case 10: {
                int verdict = 0;
                status(unit.verdict(&verdict));
                value(verdict);
                break;
            }
            case 11: status(unit.take(&state)); break;
            case 12: status(unit.restore(bytes_.below(8) != 0 ? state : this)); break;
            case 13: status(unit.free_state(&state)); break;
            case 14: forged(unit, state); break;
            default: status(unit.set_stop(bytes_.below(2) != 0)); break;
        }
    }

    // The bytes of a state with one of them changed, and a hash that fits.
    void forged(Unit& unit, void* state) {
        std::size_t size = 0;
        status(unit.size_of(state, &size));
        std::string written(size, '\0');
        status(unit.write(state, written.data(), size));
        if (size > sizeof(std::uint64_t)) {
            const std::size_t end = size - sizeof(std::uint64_t);
            const std::size_t high = bytes_.byte(), place = high * 256 + bytes_.byte();
            written[place % end] = static_cast<char>(written[place % end] ^ bytes_.byte());
            const std::uint64_t hash = fuzz::hash_of(std::string_view(written).substr(0, end));
            std::memcpy(written.data() + end, &hash, sizeof hash);
        }
        void* read = nullptr;
        const int done = unit.read(written.data(), written.size(), &read);
        status(done);
        if (done == fuzz::kOk) status(unit.restore(read));
    }

    Bytes bytes_;
    std::array<void*, kSlots> states_ = {};
    double time_ = 0.0;
    std::string given_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::size_t half = size / 2;
    const std::array<Bytes, 2> parts = {Bytes(data, half), Bytes(data + half, size - half)};
    std::array<std::string, 2> alone, together;
    for (std::size_t i = 0; i < 2; ++i) alone[i] = Course(parts[i]).run();
    std::thread other([&] { together[1] = Course(parts[1]).run(); });
    together[0] = Course(parts[0]).run();
    other.join();
    if (alone != together) std::abort();
    return 0;
}
