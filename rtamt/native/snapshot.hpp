// Snapshots: plain values one behind the other, in the processor's own byte order.
#pragma once

#include <cstddef>
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
    bool empty() const { return rest_.empty(); }

    static void require(bool condition) {
        if (!condition) throw std::invalid_argument("expected a whole state, got a damaged one");
    }

private:
    std::string_view rest_;
};

}  // namespace rtamt
