// Snapshots: plain values one behind the other, in the processor's own byte order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>

namespace rtamt {

class Writer {
public:
    template <class T>
    void put(const T* values, std::size_t count) {
        static_assert(std::is_trivially_copyable_v<T>);
        bytes_.append(reinterpret_cast<const char*>(values), count * sizeof(T));
    }
    template <class T>
    void put(const T& value) {
        put(&value, 1);
    }
    void reserve(std::size_t size) { bytes_.reserve(size); }
    const std::string& bytes() const { return bytes_; }

private:
    std::string bytes_;
};

class Reader {
public:
    explicit Reader(std::string_view bytes) : rest_(bytes) {}

    template <class T>
    void get(T* values, std::size_t count) {
        static_assert(std::is_trivially_copyable_v<T>);
        require(count <= rest_.size() / sizeof(T));
        if (count > 0) std::memcpy(values, rest_.data(), count * sizeof(T));
        rest_.remove_prefix(count * sizeof(T));
    }
    template <class T>
    T get() {
        T value;
        get(&value, 1);
        return value;
    }
    std::string_view bytes(std::size_t count) {
        require(count <= rest_.size());
        const std::string_view taken = rest_.substr(0, count);
        rest_.remove_prefix(count);
        return taken;
    }
    std::size_t size() const { return rest_.size(); }
    bool empty() const { return rest_.empty(); }

    static void require(bool condition) {
        if (!condition) throw std::invalid_argument("expected a whole state, got a damaged one");
    }

private:
    std::string_view rest_;
};

// FNV-1a, to tell the states of different programs apart.
class Fingerprint {
public:
    void add(const void* data, std::size_t size) {
        const auto* bytes = static_cast<const unsigned char*>(data);
        for (std::size_t i = 0; i < size; ++i) value_ = (value_ ^ bytes[i]) * 0x100000001b3u;
    }
    template <class T>
    void add(const T& value) {
        add(&value, sizeof(T));
    }
    void add(const std::string& text) {
        add(text.size());
        add(text.data(), text.size());
    }
    std::uint64_t value() const { return value_; }

private:
    std::uint64_t value_ = 0xcbf29ce484222325u;
};

}  // namespace rtamt
