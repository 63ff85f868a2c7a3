// Every allocation of a unit fails once: the call says so by the status of FMI, the unit is as it
// was, and the same call then succeeds. Only a step may lose what the unit knew: the unit then
// gives nothing until a state is restored. Prints how many allocations failed.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <string>

#include "units.hpp"

namespace {

long countdown = -1;  // allocations until one fails; negative: none does
bool failed = false;

void* allocated(std::size_t size) {
    if (countdown >= 0 && countdown-- == 0) {
        failed = true;
        throw std::bad_alloc();
    }
    void* memory = std::malloc(size > 0 ? size : 1);
    if (memory == nullptr) throw std::bad_alloc();
    return memory;
}

}  // namespace

void* operator new(std::size_t size) { return allocated(size); }
void* operator new[](std::size_t size) { return allocated(size); }
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete[](void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t) noexcept { std::free(memory); }

namespace {

using fuzz::Unit;

constexpr const char* kLost =
    "memory ran out in a step: reset the instance, or restore a state of before";

void require(bool holds, const std::string& what, long at) {
    if (holds) return;
    std::fprintf(stderr, "allocation %ld: expected %s\n", at, what.c_str());
    std::exit(1);
}

// All that a unit is, as bytes.
std::string state_of(Unit& unit, long at) {
    void* state = nullptr;
    std::size_t size = 0;
    require(unit.take(&state) == fuzz::kOk, "a state", at);
    require(unit.size_of(state, &size) == fuzz::kOk, "its size", at);
    std::string bytes(size, '\0');
    require(unit.write(state, bytes.data(), size) == fuzz::kOk, "its bytes", at);
    require(unit.free_state(&state) == fuzz::kOk, "the state to be freed", at);
    return bytes;
}

// One simulation whose allocation number `at` fails, if it has as many.
class Simulation {
public:
    Simulation(int version, std::size_t folder, long at) : at_(at), left_(at) {
        armed([&] { unit_ = new Unit(version, folder); });
        if (failed_ && (unit_ == nullptr || !unit_->made())) {
            delete unit_;
            unit_ = new Unit(version, folder);
        }
        require(unit_->made(), "a unit", at_);
    }
    ~Simulation() { delete unit_; }
    Simulation(const Simulation&) = delete;
    Simulation& operator=(const Simulation&) = delete;

    bool failed_once() const { return failed_; }

    std::string run() {
        call("enter", [&] { return unit_->enter(0.0, false, 0.0); });
        call("leave", [&] { return unit_->leave(); });
        std::string given;
        void* taken = nullptr;
        std::string written;
        for (int i = 0; i < 9; ++i) {
            const std::uint32_t inputs[] = {fuzz::kFirst, fuzz::kFirst + 1};
            const double values[] = {std::sin(i * 1.7) * 4, std::cos(i * 0.9) * 4};
            call("set", [&] { return unit_->set(inputs, values, 2); });
            call("step", [&] { return unit_->step(i, 1.0); });
            double outputs[3] = {};
            call("get", [&] { return unit_->get(fuzz::kOutputs, outputs, 3); });
            given.append(reinterpret_cast<const char*>(outputs), sizeof outputs);
            if (i == 4) {
                call("take", [&] { return unit_->take(&taken); });
                written = state_of(*unit_, at_);
            }
        }
        void* read = nullptr;
        call("read", [&] { return unit_->read(written.data(), written.size(), &read); });
        call("restore", [&] { return unit_->restore(taken); });
        call("restore", [&] { return unit_->restore(read); });
        given += state_of(*unit_, at_);
        call("free_state", [&] { return unit_->free_state(&taken); });
        call("free_state", [&] { return unit_->free_state(&read); });
        call("terminate", [&] { return unit_->terminate(); });
        call("reset", [&] { return unit_->reset(); });
        return given;
    }

private:
    template <class Run>
    void armed(Run run) {
        countdown = left_;
        failed = false;
        try {
            run();
        } catch (const std::bad_alloc&) {  // of the calling program, not of the unit
        }
        left_ = countdown;
        countdown = -1;
        failed_ |= failed;
    }

    template <class Call>
    void call(const std::string& name, Call each) {
        const std::string before = state_of(*unit_, at_);
        int status = fuzz::kOk;
        armed([&] { status = each(); });
        if (status == fuzz::kOk) return;
        require(failed && status == fuzz::kError, "an error of FMI by " + name + " where no memory is left", at_);
        if (name == "step") recover(before);
        require(state_of(*unit_, at_) == before, "the unit to be as it was before " + name, at_);
        require(each() == fuzz::kOk, name + " to succeed with memory", at_);
    }

    // Restores the state of before a step, if the unit is lost.
    void recover(const std::string& before) {
        double output = 0.0;
        if (unit_->get(fuzz::kOutputs, &output, 1) == fuzz::kOk) return;
        require(std::string(fuzz::said).find(kLost) != std::string::npos, kLost, at_);
        int verdict = 0;
        void* state = nullptr;
        require(unit_->verdict(&verdict) == fuzz::kError, "no verdict of a lost unit", at_);
        require(unit_->set(&fuzz::kFirst, &output, 1) == fuzz::kError, "no input of a lost unit", at_);
        require(std::string(fuzz::said).find(kLost) != std::string::npos, kLost, at_);
        require(unit_->take(&state) == fuzz::kError, "no state of a lost unit", at_);
        require(unit_->step(0.0, 1.0) == fuzz::kError, "no step of a lost unit", at_);
        require(unit_->read(before.data(), before.size(), &state) == fuzz::kOk, "a state", at_);
        require(unit_->restore(state) == fuzz::kOk, "the state to be restored", at_);
        require(unit_->free_state(&state) == fuzz::kOk, "the state to be freed", at_);
    }

    long at_;
    long left_;
    bool failed_ = false;
    Unit* unit_ = nullptr;
};

}  // namespace

int main() {
    long all = 0;
    for (const int version : {2, 3}) {
        for (std::size_t folder = 0; folder < std::size(fuzz::kFolders); ++folder) {
            const std::string expected = Simulation(version, folder, -1).run();
            for (long at = 0;; ++at) {
                Simulation simulation(version, folder, at);
                require(simulation.run() == expected, "the results of an undisturbed run", at);
                if (!simulation.failed_once()) break;
                ++all;
            }
        }
    }
    std::printf("%ld\n", all);
    return 0;
}
