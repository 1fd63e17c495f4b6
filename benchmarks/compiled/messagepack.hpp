// The bytes in which values and messages travel: those that dsr/replication/wire.py and values.py write and read.

#pragma once

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

namespace {

constexpr uint64_t MAX_COUNTER = 1ull << 53, MAX_STAMP = (1ull << 63) - 1, HORIZON = 1ull << 62;
constexpr size_t MAX_NAME = 256, MAX_LENGTH = 1 << 20, MAX_ENDS = 1000, BUNDLE = 500, MAX_WAITING = 10000;
constexpr size_t MAX_EXAMINED = 2000, MAX_WEIGHT = 256 * 1024, BYTES_OF_CHANGE = 100, SAMPLES = 512, POSE_BYTES = 64;
constexpr double MAX_LEAD = 86400.0, HISTORY = 10.0, UNIT_TOLERANCE = 1e-12;

struct Refused { const char* why; };       // ValueError
struct LeftToPython { const char* why; };  // NotImplementedError
struct Raised {};                          // Python's own error is set

struct Bytes { uint32_t references, size; };

class Value {  // in MessagePack; empty: the attribute was taken away
    Bytes* bytes_ = nullptr;
    void drop() { if (bytes_ && --bytes_->references == 0) free(bytes_); }
public:
    Value() = default;
    explicit Value(const std::string& packed) : bytes_(static_cast<Bytes*>(malloc(sizeof(Bytes) + packed.size()))) {
        if (!bytes_) throw std::bad_alloc();
        *bytes_ = {1, static_cast<uint32_t>(packed.size())};
        memcpy(bytes_ + 1, packed.data(), packed.size());
    }
    Value(const Value& other) : bytes_(other.bytes_) { if (bytes_) ++bytes_->references; }
    Value(Value&& other) noexcept : bytes_(std::exchange(other.bytes_, nullptr)) {}
    Value& operator=(Value other) noexcept { std::swap(bytes_, other.bytes_); return *this; }
    ~Value() { drop(); }
    bool is_set() const { return bytes_ != nullptr; }
    bool is_same(const Value& other) const { return bytes_ == other.bytes_; }
    const uint8_t* begin() const { return reinterpret_cast<const uint8_t*>(bytes_ + 1); }
    const uint8_t* end() const { return begin() + bytes_->size; }
};

struct Out {
    std::string bytes;
    void byte(int value) { bytes.push_back(static_cast<char>(value)); }
    void big(uint64_t value, int width) {
        value = __builtin_bswap64(value << (64 - 8 * width));
        bytes.append(reinterpret_cast<char*>(&value), width);
    }
    void coded(int code, uint64_t value, int width) { byte(code); big(value, width); }
    void natural(uint64_t n) {
        if (n < 128) byte(static_cast<int>(n));
        else if (n < 1 << 8) coded(0xcc, n, 1);
        else if (n < 1 << 16) coded(0xcd, n, 2);
        else if (n < 1ull << 32) coded(0xce, n, 4);
        else coded(0xcf, n, 8);
    }
    void integer(int64_t n) {
        if (n >= 0) natural(n);
        else if (n >= -32) byte(static_cast<int>(n & 0xff));
        else if (n >= INT8_MIN) coded(0xd0, n, 1);
        else if (n >= INT16_MIN) coded(0xd1, n, 2);
        else if (n >= INT32_MIN) coded(0xd2, n, 4);
        else coded(0xd3, n, 8);
    }
    void real(double value) { uint64_t bits; memcpy(&bits, &value, 8); coded(0xcb, bits, 8); }
    void array(size_t n) {
        if (n < 16) byte(0x90 | static_cast<int>(n));
        else if (n < 1 << 16) coded(0xdc, n, 2);
        else coded(0xdd, n, 4);
    }
    void text(std::string_view text) {
        size_t n = text.size();
        if (n < 32) byte(0xa0 | static_cast<int>(n));
        else if (n < 1 << 8) coded(0xd9, n, 1);
        else if (n < 1 << 16) coded(0xda, n, 2);
        else coded(0xdb, n, 4);
        bytes.append(text);
    }
    void blob(const char* data, size_t n) {
        if (n < 1 << 8) coded(0xc4, n, 1);
        else if (n < 1 << 16) coded(0xc5, n, 2);
        else coded(0xc6, n, 4);
        bytes.append(data, n);
    }
    void value(const Value& value) {
        if (value.is_set()) bytes.append(reinterpret_cast<const char*>(value.begin()), value.end() - value.begin());
        else byte(0xc0);
    }
    void pose(const double* numbers) {  // little-endian doubles, as x86 and ARM have them
        coded(0xc7, POSE_BYTES, 1);
        byte(1);
        bytes.append(reinterpret_cast<const char*>(numbers), POSE_BYTES);
    }
};

size_t characters(const uint8_t* at, size_t size) {  // of valid UTF-8
    size_t count = 0;
    for (const uint8_t* end = at + size; at < end; ++count) {
        if (*at < 0x80) { ++at; continue; }
        int more = *at >= 0xf0 && *at < 0xf5 ? 3 : *at >= 0xe0 && *at < 0xf0 ? 2 : *at >= 0xc2 && *at < 0xe0 ? 1 : 0;
        uint32_t code = more == 3 ? *at & 7 : more == 2 ? *at & 15 : *at & 31;
        if (more == 0 || end - at <= more) throw Refused{"text that is no UTF-8"};
        for (int i = 1; i <= more; ++i) {
            if ((at[i] & 0xc0) != 0x80) throw Refused{"text that is no UTF-8"};
            code = code << 6 | (at[i] & 0x3f);
        }
        if ((more == 2 && (code < 0x800 || (code >= 0xd800 && code < 0xe000))) ||
            (more == 3 && (code < 0x10000 || code > 0x10ffff))) throw Refused{"text that is no UTF-8"};
        at += more + 1;
    }
    return count;
}

struct In {
    const uint8_t *at, *end;
    const uint8_t* take(size_t n) {
        if (static_cast<size_t>(end - at) < n) throw Refused{"truncated"};
        return std::exchange(at, at + n);
    }
    uint8_t byte() { return *take(1); }
    uint64_t big(int width) {
        uint64_t value = 0;
        for (const uint8_t *from = take(width), *to = at; from < to; ++from) value = value << 8 | *from;
        return value;
    }
    bool nil() {
        if (at >= end || *at != 0xc0) return false;
        ++at;
        return true;
    }
    bool boolean() {
        uint8_t code = byte();
        if (code != 0xc2 && code != 0xc3) throw Refused{"no truth value"};
        return code == 0xc3;
    }
    size_t counted(int fixed, int most_fixed, int code8, int code16, int code32, size_t least_bytes) {
        int code = byte();
        size_t n;
        if ((code & ~most_fixed) == fixed) n = code & most_fixed;
        else if (code == code8 && code8) n = big(1);
        else if (code == code16) n = big(2);
        else if (code == code32) n = big(4);
        else throw Refused{"another type than expected"};
        if (n * least_bytes > static_cast<size_t>(end - at)) throw Refused{"truncated"};
        return n;
    }
    size_t array() { return counted(0x90, 0x0f, 0, 0xdc, 0xdd, 1); }
    void fields(size_t n) { if (array() != n) throw Refused{"another number of fields"}; }
    std::string_view text(size_t least, size_t most) {
        size_t n = counted(0xa0, 0x1f, 0xd9, 0xda, 0xdb, 1);
        const uint8_t* data = take(n);
        size_t length = characters(data, n);
        if (length < least || length > most) throw Refused{"a text that is too short or too long"};
        return {reinterpret_cast<const char*>(data), n};
    }
    int64_t integer(int code) {
        if (code < 0x80) return code;
        if (code >= 0xe0) return static_cast<int8_t>(code);
        switch (code) {
            case 0xcc: return big(1);
            case 0xcd: return big(2);
            case 0xce: return big(4);
            case 0xcf: {
                uint64_t n = big(8);
                if (n > MAX_STAMP) throw Refused{"a number that is too large"};
                return n;
            }
            case 0xd0: return static_cast<int8_t>(big(1));
            case 0xd1: return static_cast<int16_t>(big(2));
            case 0xd2: return static_cast<int32_t>(big(4));
            case 0xd3: return static_cast<int64_t>(big(8));
        }
        throw Refused{"another type than expected"};
    }
    uint64_t natural(uint64_t least = 0, uint64_t most = MAX_STAMP) {
        int64_t n = integer(byte());
        if (n < 0 || static_cast<uint64_t>(n) < least || static_cast<uint64_t>(n) > most)
            throw Refused{"a number out of range"};
        return n;
    }
    double real(int code) {
        double number;
        if (code == 0xcb) { uint64_t bits = big(8); memcpy(&number, &bits, 8); }
        else if (code == 0xca) { uint32_t bits = big(4); float small; memcpy(&small, &bits, 4); number = small; }
        else number = static_cast<double>(integer(code));
        if (!std::isfinite(number)) throw Refused{"a number that is not finite"};
        return number;
    }
    Value value(Out& scratch) {  // in the one form that the encoder gives it
        scratch.bytes.clear();
        uint8_t code = byte();
        if (code == 0xc0) return {};
        if (code == 0xc2 || code == 0xc3) scratch.byte(code);
        else if (code == 0xca || code == 0xcb) scratch.real(real(code));
        else if ((code & 0xe0) == 0xa0 || (code >= 0xd9 && code <= 0xdb)) { --at; scratch.text(text(0, MAX_LENGTH)); }
        else if (code >= 0xc4 && code <= 0xc6) {
            size_t n = big(1 << (code - 0xc4));
            if (n > MAX_LENGTH) throw Refused{"bytes that are too long"};
            scratch.blob(reinterpret_cast<const char*>(take(n)), n);
        } else if ((code & 0xf0) == 0x90 || code == 0xdc || code == 0xdd) {
            --at;
            size_t n = counted(0x90, 0x0f, 0, 0xdc, 0xdd, 1);
            if (n > MAX_LENGTH) throw Refused{"an array that is too long"};
            scratch.array(n);
            while (n--) scratch.real(real(byte()));
        } else if (code == 0xc7 && end - at > 1 && at[0] == POSE_BYTES && at[1] == 1) {
            double n[8];
            memcpy(n, take(2 + POSE_BYTES) + 2, POSE_BYTES);
            if (!std::isfinite(n[0] + n[1] + n[2] + n[7])) throw Refused{"a number that is not finite"};
            double off = n[3] * n[3] + n[4] * n[4] + n[5] * n[5] + n[6] * n[6] - 1.0;
            if (!(std::fabs(off) < UNIT_TOLERANCE)) throw LeftToPython{"a rotation that is to be normalised"};
            scratch.pose(n);
        } else if (code >= 0xc7 && code <= 0xc9) throw LeftToPython{"an extension"};
        else scratch.integer(integer(code));
        return Value(scratch.bytes);
    }
};

}  // namespace
