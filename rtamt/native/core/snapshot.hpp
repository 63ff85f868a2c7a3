// Snapshots of machines: plain values one behind the other, in the processor's own byte order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace rtamt {

// Machines count fewer samples than this, so that a count and the bounds of windows have a sum.
inline constexpr std::int64_t kMaxSamples = std::int64_t{1} << 62;

// A snapshot that is being written or read. Whatever has a state lists its fields once, in a
// function `fields(Snapshot&)` that serves both directions.
class Snapshot {
public:
    Snapshot() = default;  // writes
    explicit Snapshot(std::string_view bytes) : reads_(true), rest_(bytes) {}

    bool reads() const { return reads_; }
    std::string written() && { return std::move(written_); }
    std::size_t unread() const { return rest_.size(); }

    template <class... T>
    void operator()(T&... values) {
        (value(values), ...);
    }
    template <class T>
    void array(T* values, std::size_t count) {
        static_assert(std::is_trivially_copyable_v<T>);
        if (!reads_) {
            written_.append(reinterpret_cast<const char*>(values), count * sizeof(T));
            return;
        }
        require_unread<T>(count);
        if (count > 0) std::memcpy(values, rest_.data(), count * sizeof(T));
        rest_.remove_prefix(count * sizeof(T));
    }
    // What consists of doubles, none of which is nan.
    template <class T>
    void numbers(T* values, std::size_t count) {
        static_assert(sizeof(T) % sizeof(double) == 0);
        const std::string_view bytes = rest_.substr(0, count * sizeof(T));  // none if it writes
        array(values, count);
        for (std::size_t at = 0; at < bytes.size(); at += sizeof(double)) {
            double number;
            std::memcpy(&number, bytes.data() + at, sizeof number);
            require(number == number);
        }
    }
    // A vector of any size, behind that size.
    template <class T>
    void sized(std::vector<T>& values) {
        std::size_t count = values.size();
        value(count);
        if (reads_) {
            require_unread<T>(count);
            values.resize(count);
        }
        array(values.data(), count);
    }

    // Numbers of samples.
    void counts(std::int64_t* samples, std::size_t size) {
        array(samples, size);
        for (std::size_t i = 0; i < size; ++i) require(samples[i] >= 0 && samples[i] < kMaxSamples);
    }

    // When reading, refuses values that no machine writes.
    void require(bool condition) const {
        if (reads_ && !condition)
            throw std::invalid_argument("expected a whole state, got a damaged one");
    }
    template <class T>
    void require_unread(std::size_t count) const {
        require(count <= rest_.size() / sizeof(T));
    }

private:
    template <class T>
    void value(T& value) {
        array(&value, 1);
    }
    void value(bool& value) {
        std::uint8_t byte = value;
        array(&byte, 1);
        value = byte != 0;
    }

    bool reads_ = false;
    std::string written_;
    std::string_view rest_;
};

// A hash that tells the programs of machines apart (FNV-1a).
class Fingerprint {
public:
    template <class... T>
    void add(const T&... values) {
        (add_one(values), ...);
    }
    std::uint64_t value() const { return value_; }

private:
    template <class T>
    void add_one(const T& value) {
        static_assert(std::is_arithmetic_v<T>);
        add_bytes(&value, sizeof value);
    }
    void add_one(const std::string& text) {
        add_one(text.size());
        add_bytes(text.data(), text.size());
    }
    void add_bytes(const void* data, std::size_t size) {
        const auto* bytes = static_cast<const unsigned char*>(data);
        for (std::size_t i = 0; i < size; ++i) value_ = (value_ ^ bytes[i]) * 0x100000001b3u;
    }

    std::uint64_t value_ = 0xcbf29ce484222325u;
};

inline constexpr const char* kForeign =
    "expected a state that a native machine with this program gave; "
    "those of other programs, back-ends or processors do not fit";

// The snapshot of a machine, which begins with the fingerprint of its program.
template <class M>
std::string state_of(M& machine) {
    Snapshot out;
    std::uint64_t fingerprint = machine.fingerprint();
    out(fingerprint);
    machine.fields(out);
    return std::move(out).written();
}

// Throws std::invalid_argument on bytes that are no snapshot of a machine with this program, or a
// damaged one: then nothing changes.
template <class M>
void restore_from(M& machine, std::string_view bytes) {
    Snapshot in(bytes);
    std::uint64_t fingerprint = 0;
    if (bytes.size() >= sizeof fingerprint) in(fingerprint);
    if (fingerprint != machine.fingerprint()) throw std::invalid_argument(kForeign);
    const std::string before = state_of(machine);
    const auto read = [&machine](Snapshot& state) {
        machine.reset();
        machine.fields(state);
        state.require(state.unread() == 0);
    };
    try {
        read(in);
    } catch (...) {
        Snapshot back(before);
        back(fingerprint);
        read(back);
        throw;
    }
}

}  // namespace rtamt
