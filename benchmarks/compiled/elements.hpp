// Dots and what of them was seen, names, incarnations with their registers, elements, and messages as they are written.

#pragma once

#include "messagepack.hpp"

namespace {

struct Range { uint64_t first, last; };
struct Entry;
struct Element;

struct Name {
    std::string id;
    uint64_t hash = 0;
    PyObject* text = nullptr;
    PyObject* object() {  // a new reference
        if (!text && !(text = PyUnicode_FromStringAndSize(id.data(), id.size()))) throw Raised{};
        return Py_NewRef(text);
    }
};

struct Replica : Name {  // and what of its dots was seen, and which of them live
    uint64_t known = 0;
    std::vector<Range> beyond;
    std::vector<std::pair<uint64_t, Entry*>> made;
    uint64_t message = 0;
    size_t index = 0;

    auto place(uint64_t counter) {
        auto less = [](const std::pair<uint64_t, Entry*>& one, uint64_t wanted) { return one.first < wanted; };
        return std::lower_bound(made.begin(), made.end(), counter, less);
    }
    Entry* find(uint64_t counter) {
        auto found = place(counter);
        return found != made.end() && found->first == counter ? found->second : nullptr;
    }
    static bool ends_before(const Range& range, uint64_t counter) { return range.last < counter; }
    bool covers(uint64_t counter) const {
        if (counter <= known) return true;
        auto found = std::lower_bound(beyond.begin(), beyond.end(), counter, ends_before);
        return found != beyond.end() && found->first <= counter;
    }
    void see(uint64_t first, uint64_t last) {
        if (last <= known || last < first) return;
        if (beyond.empty() && first <= known + 1) { known = last; return; }
        if (!beyond.empty() && first > beyond.back().last + 1) { beyond.push_back({first, last}); return; }
        first = std::max(first, known + 1);
        auto begins_after = [](uint64_t wanted, const Range& range) { return wanted < range.first; };
        auto from = std::lower_bound(beyond.begin(), beyond.end(), first - 1, ends_before);
        auto to = std::upper_bound(beyond.begin(), beyond.end(), last + 1, begins_after);
        if (from < to) { first = std::min(first, from->first); last = std::max(last, (to - 1)->last); }
        beyond.insert(beyond.erase(from, to), {first, last});
        if (beyond[0].first == known + 1) { known = beyond[0].last; beyond.erase(beyond.begin()); }
    }
};

struct Dot {
    Replica* rid = nullptr;
    uint64_t counter = 0;
    bool operator==(const Dot& other) const { return rid == other.rid && counter == other.counter; }
    bool operator<(const Dot& other) const {
        return rid == other.rid ? counter < other.counter : rid->id < other.rid->id;
    }
};
struct DotHash {
    size_t operator()(const Dot& dot) const { return dot.rid->hash + dot.counter * 0xBF58476D1CE4E5B9ull; }
};

enum Kind { BOOL, INT, FLOAT, STR, BYTES, VECTOR, POSE, UNKNOWN };

struct Text : Name {  // of a node, a type or an attribute, and what the schema and the indexes have under it
    Kind kind = UNKNOWN;
    int64_t length = -1;
    bool stream = false, node_type = false, edge_type = false, geometric = false;
    std::string record;  // how names of nodes of this type must begin, for those about the graph itself
    Element* node = nullptr;
    std::vector<Element*> nodes, edges;  // visible ones of this type
};

struct Write {
    Dot owner;
    Text* attribute;
    uint64_t stamp;
    Replica* writer;
    Dot dot;  // without a replica: a sample of a stream
    Value value;
};

struct Register {
    Text* attribute;
    uint64_t stamp = 0;
    Replica* writer = nullptr;
    Dot dot;
    Value value;
    uint64_t batch = 0;  // of the outbox that holds it as a sample
    size_t sample = 0;
};

struct Entry {  // an incarnation
    Dot dot;
    Element* element;
    Text* type;
    std::vector<Dot> sources, destinations;
    std::vector<Register> registers;
    bool announced = false, unattached = false;
    Register* find(const Text* attribute) {
        for (Register& one : registers) if (one.attribute == attribute) return &one;
        return nullptr;
    }
};

using Sample = std::array<double, 8>;

struct Element {  // a node by its name, or an edge by its key
    Text *source = nullptr, *destination = nullptr, *name;  // of an edge, `name` is the type
    Text* type = nullptr;  // of what is visible
    std::vector<Entry*> live, seen;
    std::vector<Element*> incident;  // edges at a node, visible or not
    std::vector<Sample> poses;
    size_t place = 0, pending = 0;
    bool is_node() const { return source == nullptr; }
};

struct EdgeKey {
    Text *source, *destination, *type;
    bool operator==(const EdgeKey& other) const {
        return source == other.source && destination == other.destination && type == other.type;
    }
};
struct EdgeHash {
    size_t operator()(const EdgeKey& key) const {
        return (key.source->hash * 31 + key.destination->hash) * 31 + key.type->hash;
    }
};

template <class T> class Names {  // by their text, for ever
    std::vector<T*> slots_ = std::vector<T*>(64, nullptr);
public:
    std::vector<std::unique_ptr<T>> all;
    T* get(std::string_view id) {
        uint64_t hash = 14695981039346656037ull;
        for (unsigned char byte : id) hash = (hash ^ byte) * 1099511628211ull;
        size_t at = hash & (slots_.size() - 1);
        for (; slots_[at]; at = (at + 1) & (slots_.size() - 1))
            if (slots_[at]->hash == hash && slots_[at]->id == id) return slots_[at];
        all.push_back(std::make_unique<T>());
        T* made = slots_[at] = all.back().get();
        made->id = id;
        made->hash = hash;
        if (all.size() * 2 > slots_.size()) {
            std::vector<T*> larger(slots_.size() * 4, nullptr);
            for (auto& one : all) {
                size_t place = one->hash & (larger.size() - 1);
                while (larger[place]) place = (place + 1) & (larger.size() - 1);
                larger[place] = one.get();
            }
            slots_.swap(larger);
        }
        return made;
    }
    T* get(PyObject* text) {
        Py_ssize_t size;
        const char* data = PyUnicode_Check(text) ? PyUnicode_AsUTF8AndSize(text, &size) : nullptr;
        if (!data) { PyErr_Clear(); throw Refused{"expected a text"}; }
        return get(std::string_view(data, size));
    }
    ~Names() { for (auto& one : all) Py_XDECREF(one->text); }
};

struct Seen { Replica* rid; uint64_t first, last; };
struct Add { Dot dot; EdgeKey key; Text* type; std::vector<Dot> sources, destinations; };  // a node: key.source alone

struct Delta {
    std::vector<Add> adds;
    std::vector<Write> writes;
    std::vector<Dot> removed, live;
    std::vector<Seen> context, examined;
    bool is_reply = false;
};

struct Change { char kind; Text* type; };
struct Pending {
    Element* element;
    int count = 0;
    Change changes[3];
    std::vector<Text*> attributes;
};

uint64_t dot_hash(const Dot& dot) {
    uint64_t tail = 0;
    size_t size = dot.rid->id.size(), from = size > 8 ? size - 8 : 0;
    memcpy(&tail, dot.rid->id.data() + from, size - from);
    uint64_t mixed = tail * 0x9E3779B97F4A7C15ull + dot.counter * 0xBF58476D1CE4E5B9ull;
    return mixed ^ (mixed >> 29);
}

uint64_t stamp_at(double time) {
    double micros = time * 1e6;
    if (!(micros > 0)) return 0;
    return micros >= static_cast<double>(HORIZON >> 10) ? HORIZON : static_cast<uint64_t>(micros) << 10;
}

std::pair<bool, size_t> length_of(const Value& value) {  // whether it is a vector; length of a vector, text or bytes
    if (!value.is_set()) return {false, 0};
    In in{value.begin(), value.end()};
    int code = *in.at;
    if ((code & 0xf0) == 0x90 || code == 0xdc || code == 0xdd) return {true, in.array()};
    if ((code & 0xe0) == 0xa0 || (code >= 0xd9 && code <= 0xdb)) {
        size_t n = in.counted(0xa0, 0x1f, 0xd9, 0xda, 0xdb, 1);
        return {false, characters(in.at, n)};
    }
    if (code >= 0xc4 && code <= 0xc6) { ++in.at; return {false, in.big(1 << (code - 0xc4))}; }
    return {false, 0};
}

struct Message {  // one that is written: replicas are told by indexes, in the order of their first use
    Out body;
    std::vector<Replica*> names;
    uint64_t number;
    explicit Message(uint64_t number) : number(number) {}
    void replica(Replica* rid) {
        if (rid->message != number) { rid->message = number; rid->index = names.size(); names.push_back(rid); }
        body.natural(rid->index);
    }
    void dots(const std::vector<Dot>& dots) {
        body.array(2 * dots.size());
        for (const Dot& dot : dots) { replica(dot.rid); body.natural(dot.counter); }
    }
    void ranges(const std::vector<Seen>& ranges) {
        body.array(3 * ranges.size());
        for (const Seen& one : ranges) { replica(one.rid); body.natural(one.first); body.natural(one.last); }
    }
    using Dots = std::vector<Dot>;
    void add(const Dot& dot, const EdgeKey& key, const Text* type, const Dots& from, const Dots& to) {
        body.array(6);
        replica(dot.rid);
        body.natural(dot.counter);
        if (key.destination) body.array(3);
        body.text(key.source->id);
        if (key.destination) { body.text(key.destination->id); body.text(key.type->id); }
        body.text(type->id);
        dots(from);
        dots(to);
    }
    template <class W> void write(const Dot& owner, const W& write) {
        body.array(8);
        replica(owner.rid);
        body.natural(owner.counter);
        body.text(write.attribute->id);
        body.natural(write.stamp);
        replica(write.writer);
        replica(write.dot.rid ? write.dot.rid : write.writer);
        body.natural(write.dot.counter);
        body.value(write.value);
    }
    PyObject* finished(size_t fields) {
        Out whole;
        whole.bytes.reserve(body.bytes.size() + 64);
        whole.array(fields);
        whole.natural(1);  // version
        whole.array(names.size());
        for (Replica* rid : names) whole.text(rid->id);
        whole.bytes += body.bytes;
        PyObject* made = PyBytes_FromStringAndSize(whole.bytes.data(), whole.bytes.size());
        if (!made) throw Raised{};
        return made;
    }
};

using Given = std::vector<std::pair<Text*, Value>>;

}  // namespace
