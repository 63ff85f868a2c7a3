// The bytes of a fuzzer, read as choices and numbers; behind the last byte all of them are 0.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string_view>

#include "core/snapshot.hpp"

namespace fuzz {

class Bytes {
public:
    Bytes(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}

    bool empty() const { return at_ == size_; }
    std::size_t left() const { return size_ - at_; }

    std::uint8_t byte() { return at_ < size_ ? data_[at_++] : 0; }
    std::size_t below(std::size_t n) { return byte() % n; }

    // Small numbers that machines compare with each other, and now and then any number at all.
    double number() {
        static constexpr double kInfinity = std::numeric_limits<double>::infinity();
        const std::uint8_t kind = byte();
        if (kind < 0xF0) return (kind - 120) / 8.0;
        if (kind == 0xF0) return -0.0;
        if (kind == 0xF1) return kInfinity;
        if (kind == 0xF2) return -kInfinity;
        if (kind == 0xF3) return std::numeric_limits<double>::quiet_NaN();
        std::uint64_t bits = 0;
        for (int i = 0; i < 8; ++i) bits = bits << 8 | byte();
        double value = 0.0;
        std::memcpy(&value, &bits, sizeof value);
        return value;
    }

    std::string_view rest() {
        const std::string_view rest(reinterpret_cast<const char*>(data_) + at_, left());
        at_ = size_;
        return rest;
    }

private:
    const std::uint8_t* data_;
    std::size_t size_;
    std::size_t at_ = 0;
};

// As program files and states are hashed.
inline std::uint64_t hash_of(std::string_view bytes) {
    rtamt::Fingerprint print;
    for (const char c : bytes) print.add(c);
    return print.value();
}

}  // namespace fuzz
