// A prototype of a compiled core of the memory, to measure what one would gain: python -m benchmarks.compiled
//
// A `Core` is one replica: dots, causal context, incarnations, last-writer-wins registers, hybrid clock, removal, edges
// that wait for their ends, indexes, histories of poses, changes for a watch, what is to be sent, and the wire format
// of deltas and pieces. It does what dsr/crdt, dsr/graph, dsr/frames and dsr/replication do on the way of the measured
// rows, under their names; they are the oracle that it is compared with. What is not on that way is left out, or raises
// NotImplementedError: covariances, numpy values, forks, parts, gates, durable samples, answers to who knows something.
//
// All data are native. A value is kept as the MessagePack that it travels as, and becomes an object when it is read.

#include "replica.hpp"

namespace {

PyObject* kept(PyObject* made) { if (!made) throw Raised{}; return made; }

struct Held {  // a reference that is given back
    PyObject* object;
    explicit Held(PyObject* object) : object(kept(object)) {}
    Held(const Held&) = delete;
    ~Held() { Py_DECREF(object); }
};

double number_of(PyObject* given) {
    if (!PyFloat_Check(given) && !(PyLong_Check(given) && !PyBool_Check(given))) throw LeftToPython{"no plain number"};
    double number = PyFloat_AsDouble(given);
    if (PyErr_Occurred()) { PyErr_Clear(); throw Refused{"a number that is too large"}; }
    if (!std::isfinite(number)) throw Refused{"a number that is not finite"};
    return number;
}

void numbers_of(PyObject* pose, const char* field, double* to, Py_ssize_t count) {
    Held tuple(PyObject_GetAttrString(pose, field));
    if (!PyTuple_Check(tuple.object) || PyTuple_GET_SIZE(tuple.object) != count) throw Refused{"no pose"};
    for (Py_ssize_t i = 0; i < count; ++i) to[i] = number_of(PyTuple_GET_ITEM(tuple.object, i));
}

constexpr Py_ssize_t LONGEST = MAX_LENGTH;

Value value_of(Core& core, const Text* attribute, PyObject* given) {
    Out& out = core.scratch;
    out.bytes.clear();
    switch (attribute->kind) {
        case BOOL:
            if (!PyBool_Check(given)) throw LeftToPython{"no plain truth value"};
            out.byte(given == Py_True ? 0xc3 : 0xc2);
            break;
        case INT: {
            if (!PyLong_Check(given) || PyBool_Check(given)) throw LeftToPython{"no plain integer"};
            int64_t number = PyLong_AsLongLong(given);
            if (PyErr_Occurred()) { PyErr_Clear(); throw Refused{"an integer that is too large"}; }
            out.integer(number);
            break;
        }
        case FLOAT: out.real(number_of(given)); break;
        case STR: {
            Py_ssize_t size;
            const char* data = PyUnicode_Check(given) ? PyUnicode_AsUTF8AndSize(given, &size) : nullptr;
            if (!data || PyUnicode_GET_LENGTH(given) > LONGEST) {
                PyErr_Clear();
                throw Refused{"no text"};
            }
            out.text({data, static_cast<size_t>(size)});
            break;
        }
        case BYTES:
            if (!PyBytes_Check(given) || PyBytes_GET_SIZE(given) > LONGEST) throw Refused{"no bytes"};
            out.blob(PyBytes_AS_STRING(given), PyBytes_GET_SIZE(given));
            break;
        case VECTOR: {
            if (!PyTuple_Check(given) && !PyList_Check(given)) throw LeftToPython{"no plain vector"};
            Py_ssize_t n = PySequence_Fast_GET_SIZE(given);
            if ((attribute->length >= 0 && n != attribute->length) || n > LONGEST)
                throw Refused{"a vector of another length"};
            out.array(n);
            for (Py_ssize_t i = 0; i < n; ++i) out.real(number_of(PySequence_Fast_GET_ITEM(given, i)));
            break;
        }
        case POSE: {
            double numbers[8];
            Held covariance(PyObject_GetAttrString(given, "cov")), stamp(PyObject_GetAttrString(given, "stamp"));
            if (covariance.object != Py_None) throw LeftToPython{"a covariance"};
            numbers_of(given, "t", numbers, 3);
            numbers_of(given, "q", numbers + 3, 4);
            numbers[7] = number_of(stamp.object);
            out.pose(numbers);
            break;
        }
        default: throw Refused{"unknown attribute"};
    }
    return Value(out.bytes);
}

PyObject* object_of(Core& core, const Value& value) {
    if (!value.is_set()) return Py_NewRef(Py_None);
    In in{value.begin(), value.end()};
    int code = in.byte();
    if (code == 0xc2 || code == 0xc3) return PyBool_FromLong(code == 0xc3);
    if (code == 0xcb) return PyFloat_FromDouble(in.real(code));
    --in.at;
    if ((code & 0xe0) == 0xa0 || (code >= 0xd9 && code <= 0xdb)) {
        std::string_view text = in.text(0, MAX_LENGTH);
        return PyUnicode_FromStringAndSize(text.data(), text.size());
    }
    if (code >= 0xc4 && code <= 0xc6) {
        ++in.at;
        size_t n = in.big(1 << (code - 0xc4));
        return PyBytes_FromStringAndSize(reinterpret_cast<const char*>(in.at), n);
    }
    if ((code & 0xf0) == 0x90 || code == 0xdc || code == 0xdd) {
        size_t n = in.array();
        PyObject* tuple = kept(PyTuple_New(n));
        for (size_t i = 0; i < n; ++i) PyTuple_SET_ITEM(tuple, i, PyFloat_FromDouble(in.real(in.byte())));
        return tuple;
    }
    if (code == 0xc7) {
        double n[8];
        memcpy(n, in.at + 3, POSE_BYTES);
        return PyObject_CallFunction(core.make_pose, "(ddd)(dddd)d", n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7]);
    }
    ++in.at;
    return PyLong_FromLongLong(in.integer(code));
}

PyObject* dot_object(const Dot& dot) {
    return dot.rid ? kept(Py_BuildValue("(NK)", dot.rid->object(), dot.counter)) : Py_NewRef(Py_None);
}
PyObject* dots_object(const std::vector<Dot>& dots) {
    PyObject* tuple = kept(PyTuple_New(dots.size()));
    for (size_t i = 0; i < dots.size(); ++i) PyTuple_SET_ITEM(tuple, i, dot_object(dots[i]));
    return tuple;
}
PyObject* key_object(const Element* element) {
    if (element->is_node()) return element->name->object();
    return kept(Py_BuildValue(
        "(NNN)", element->source->object(), element->destination->object(), element->name->object()));
}
void put_item(PyObject* dict, PyObject* key, PyObject* value) {
    Held held_key(key), held_value(value);
    if (PyDict_SetItem(dict, key, value)) throw Raised{};
}

struct CoreObject { PyObject_HEAD Core* core; };
using Arguments = PyObject* const*;

template <class F> PyObject* guarded(F act) {
    try { return act(); }
    catch (const Refused& error) { PyErr_SetString(PyExc_ValueError, error.why); }
    catch (const LeftToPython& error) { PyErr_SetString(PyExc_NotImplementedError, error.why); }
    catch (const Raised&) {}
    catch (const std::exception& error) { PyErr_SetString(PyExc_MemoryError, error.what()); }
    return nullptr;
}
template <PyObject* (*ACT)(Core&, Arguments), int COUNT>
PyObject* method(PyObject* self, Arguments given, Py_ssize_t count) {
    return guarded([&]() -> PyObject* {
        if (count != COUNT) throw Refused{"another number of arguments"};
        return ACT(*reinterpret_cast<CoreObject*>(self)->core, given);
    });
}

Given given_values(Core& core, PyObject* attributes, const Element* present) {
    if (!PyDict_Check(attributes)) throw Refused{"expected a dictionary"};
    Given values;
    PyObject *name, *value;
    for (Py_ssize_t at = 0; PyDict_Next(attributes, &at, &name, &value);) {
        Text* attribute = core.texts.get(name);
        if (attribute->kind == UNKNOWN) throw Refused{"unknown attribute"};
        if (value != Py_None) { values.emplace_back(attribute, value_of(core, attribute, value)); continue; }
        Register* held = present ? Core::winner(present, attribute) : nullptr;  // None takes away what is set
        if (held && held->value.is_set()) values.emplace_back(attribute, Value());
    }
    return values;
}
void check_name(Core& core, const Text* name, const Text* type) {
    const std::string& id = name->id;
    bool is_name = !id.empty() && id.size() <= 128 && std::all_of(id.begin(), id.end(), [](char c) {
        bool is_letter = (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z');
        return is_letter || (c >= '0' && c <= '9') || c == '_' || c == '.' || c == '-';
    });
    if (!is_name || !type->node_type || !type->record.empty() || !core.is_own_name(id, type))
        throw Refused{"no such name or type"};
}
PyObject* add_node(Core& core, Arguments given) {  // name, type, attributes, now
    EdgeKey key{core.texts.get(given[0])};
    Text* type = core.texts.get(given[1]);
    check_name(core, key.source, type);
    Given values = given_values(core, given[2], nullptr);
    core.put(key, type, values, number_of(given[3]));
    Py_RETURN_NONE;
}
PyObject* add_edge(Core& core, Arguments given) {  // source, destination, type, attributes, now
    EdgeKey key{core.texts.get(given[0]), core.texts.get(given[1]), core.texts.get(given[2])};
    if (!key.type->edge_type) throw Refused{"unknown edge type"};
    Given values = given_values(core, given[3], nullptr);
    core.put(key, key.type, values, number_of(given[4]));
    Py_RETURN_NONE;
}
Element* node_at(Core& core, PyObject* name) {
    Element* element = core.node(core.texts.get(name));
    if (element->seen.empty()) throw Refused{"no such node"};
    return element;
}
Element* edge_at(Core& core, Arguments key) {
    auto found = core.edges.find({core.texts.get(key[0]), core.texts.get(key[1]), core.texts.get(key[2])});
    if (found == core.edges.end() || found->second->seen.empty()) throw Refused{"no such edge"};
    return found->second;
}
PyObject* written(Core& core, Element* element, PyObject* attributes, PyObject* now) {
    Given values = given_values(core, attributes, element);
    if (!values.empty() || PyDict_GET_SIZE(attributes) == 0)
        core.commit(std::vector<Entry*>(element->seen), nullptr, values, number_of(now));
    Py_RETURN_NONE;
}
PyObject* write_node(Core& core, Arguments given) { return written(core, node_at(core, given[0]), given[1], given[2]); }
PyObject* write_edge(Core& core, Arguments given) { return written(core, edge_at(core, given), given[3], given[4]); }
PyObject* remove_node(Core& core, Arguments given) { core.take_away(node_at(core, given[0])); Py_RETURN_NONE; }
PyObject* remove_edge(Core& core, Arguments given) { core.take_away(edge_at(core, given)); Py_RETURN_NONE; }
PyObject* value_in(Core& core, const Element* element, PyObject* attribute) {
    Register* held = Core::winner(element, core.texts.get(attribute));
    return held ? object_of(core, held->value) : Py_NewRef(Py_None);
}
PyObject* get_node(Core& core, Arguments given) { return value_in(core, node_at(core, given[0]), given[1]); }
PyObject* get_edge(Core& core, Arguments given) { return value_in(core, edge_at(core, given), given[3]); }

PyObject* nodes(Core& core, Arguments given) {  // names of those of a type
    const std::vector<Element*>& found = core.texts.get(given[0])->nodes;
    PyObject* list = kept(PyList_New(found.size()));
    for (size_t i = 0; i < found.size(); ++i) PyList_SET_ITEM(list, i, found[i]->name->object());
    return list;
}
PyObject* take(Core& core, Arguments) {  // messages with durable changes, and one with samples or None
    Held list(PyList_New(0));
    for (const Delta& bundle : core.bundles)
        if (!bundle.context.empty()) {
            Held payload(core.encoded(bundle));
            if (PyList_Append(list.object, payload.object)) throw Raised{};
        }
    Delta streamed;
    streamed.writes = std::move(core.samples);
    PyObject* payload = streamed.writes.empty() ? Py_NewRef(Py_None) : core.encoded(streamed);
    core.samples.clear();
    ++core.batch;
    core.bundles.assign(1, Delta());
    return Py_BuildValue("(ON)", list.object, payload);
}
In bytes_of(PyObject* payload) {
    if (!PyBytes_Check(payload)) throw Refused{"expected bytes"};
    const uint8_t* data = reinterpret_cast<const uint8_t*>(PyBytes_AS_STRING(payload));
    return {data, data + PyBytes_GET_SIZE(payload)};
}
PyObject* receive(Core& core, Arguments given) {  // sender, payload, now; False for what is to be judged by Python
    Delta delta = core.read_delta(bytes_of(given[1]));
    if (!core.is_plain(core.replicas.get(given[0]), delta)) Py_RETURN_FALSE;
    core.join(delta, number_of(given[2]));
    Py_RETURN_TRUE;
}
PyObject* join(Core& core, Arguments given) {  // payload, now
    Delta delta = core.read_delta(bytes_of(given[0]));
    core.join(delta, number_of(given[1]));
    Py_RETURN_NONE;
}
PyObject* join_piece(Core& core, Arguments given) {  // payload, now
    Delta delta = core.read_piece(bytes_of(given[0]));
    core.join(delta, number_of(given[1]));
    Py_RETURN_NONE;
}
PyObject* pieces(Core& core, Arguments) {  // all, for who knows nothing
    std::vector<Replica*> rids;
    for (auto& rid : core.replicas.all) rids.push_back(rid.get());
    std::sort(rids.begin(), rids.end(), [](Replica* one, Replica* other) { return one->id < other->id; });
    std::vector<Entry*> all;
    for (Replica* rid : rids) for (auto& made : rid->made) all.push_back(made.second);
    Held list(PyList_New(0));
    size_t begin = 0;
    do {
        size_t end;
        Held payload(core.piece(all, begin, end));
        if (PyList_Append(list.object, payload.object)) throw Raised{};
        begin = end;
    } while (begin < all.size());
    return Py_NewRef(list.object);
}
PyObject* watch(Core& core, Arguments) { core.watched = true; Py_RETURN_NONE; }
PyObject* waits(Core& core, Arguments) { return PyLong_FromSize_t(core.pending.size()); }
PyObject* changes(Core& core, Arguments) {  // (kind, key, type, names of attributes), as a watch is told
    Held list(PyList_New(0));
    for (const Pending& one : core.pending) {
        one.element->pending = 0;
        for (int i = 0; i < one.count; ++i) {
            Held names(PyFrozenSet_New(nullptr));
            for (Text* name : one.changes[i].kind == 'r' ? std::vector<Text*>() : one.attributes) {
                Held text(name->object());
                if (PySet_Add(names.object, text.object)) throw Raised{};
            }
            char kind[2] = {one.changes[i].kind, 0};
            PyObject* type = one.changes[i].type->object();
            Held change(Py_BuildValue("(sNNO)", kind, key_object(one.element), type, names.object));
            if (PyList_Append(list.object, change.object)) throw Raised{};
        }
    }
    core.pending.clear();
    return Py_NewRef(list.object);
}
PyObject* poses(Core& core, Arguments given) {  // the recent poses of an edge
    const Element* edge = edge_at(core, given);
    PyObject* list = kept(PyList_New(edge->poses.size()));
    for (size_t i = 0; i < edge->poses.size(); ++i) {
        Out out;
        out.pose(edge->poses[i].data());
        PyList_SET_ITEM(list, i, kept(object_of(core, Value(out.bytes))));
    }
    return list;
}
PyObject* entry_object(Core& core, Entry* entry) {  // (key, type, sources, destinations, {attribute: write})
    PyObject* registers = kept(PyDict_New());
    for (const Register& one : entry->registers)
        put_item(registers, one.attribute->object(), kept(Py_BuildValue(
            "(KNNN)", one.stamp, one.writer->object(), dot_object(one.dot), object_of(core, one.value))));
    return kept(Py_BuildValue("(NNNNN)", key_object(entry->element), entry->type->object(), dots_object(entry->sources),
                              dots_object(entry->destinations), registers));
}
// context, entries, visible elements, fingerprint, newest stamp, number of waiting writes
PyObject* state(Core& core, Arguments) {
    PyObject *context = kept(PyDict_New()), *entries = kept(PyDict_New()), *visible = kept(PyDict_New());
    for (auto& rid : core.replicas.all) {
        if (rid->known || !rid->beyond.empty()) {
            PyObject* beyond = kept(PyList_New(0));
            for (const Range& one : rid->beyond) {
                Held range(Py_BuildValue("(KK)", one.first, one.last));
                if (PyList_Append(beyond, range.object)) throw Raised{};
            }
            put_item(context, rid->object(), kept(Py_BuildValue("(KN)", rid->known, beyond)));
        }
        for (auto& made : rid->made) put_item(entries, dot_object(made.second->dot), entry_object(core, made.second));
    }
    for (auto& text : core.texts.all) for (auto* group : {&text->nodes, &text->edges}) for (Element* element : *group) {
        std::vector<Dot> dots;
        for (Entry* entry : element->seen) dots.push_back(entry->dot);
        put_item(visible, key_object(element), kept(Py_BuildValue("(NN)", element->type->object(), dots_object(dots))));
    }
    size_t waiting = 0;
    for (auto& one : core.waiting) waiting += one.second.size();
    return Py_BuildValue("(NNNKKn)", context, entries, visible, core.fingerprint, core.latest, waiting);
}

// Core(rid, attributes, node types, edge types, records, make_pose)
PyObject* make(PyTypeObject* type, PyObject* arguments, PyObject*) {
    const char* rid;
    PyObject *attributes, *node_types, *edge_types, *records, *make_pose, *name, *value;
    PyTypeObject* dict = &PyDict_Type;
    if (!PyArg_ParseTuple(arguments, "sO!O!O!O!O", &rid, dict, &attributes, dict, &node_types, dict, &edge_types, dict,
                          &records, &make_pose)) return nullptr;
    CoreObject* self = reinterpret_cast<CoreObject*>(type->tp_alloc(type, 0));
    if (!self) return nullptr;
    self->core = new Core();
    Held held(reinterpret_cast<PyObject*>(self));
    return guarded([&]() -> PyObject* {
        Core& core = *self->core;
        core.self = core.replicas.get(std::string_view(rid));
        core.pose = core.texts.get(std::string_view("pose"));
        core.make_pose = Py_NewRef(make_pose);
        for (Py_ssize_t at = 0; PyDict_Next(attributes, &at, &name, &value);) {  // name: (kind, length or -1, stream)
            Text* text = core.texts.get(name);
            int kind, stream;
            long long length;
            if (!PyArg_ParseTuple(value, "iLp", &kind, &length, &stream)) throw Raised{};
            text->kind = static_cast<Kind>(kind);
            text->length = length;
            text->stream = stream;
        }
        for (Py_ssize_t at = 0; PyDict_Next(node_types, &at, &name, &value);) core.texts.get(name)->node_type = true;
        for (Py_ssize_t at = 0; PyDict_Next(edge_types, &at, &name, &value);) {  // name: whether it is geometric
            core.texts.get(name)->edge_type = true;
            core.texts.get(name)->geometric = value == Py_True;
        }
        for (Py_ssize_t at = 0; PyDict_Next(records, &at, &name, &value);) {  // node type: beginning of names
            core.records.push_back(core.texts.get(name));
            core.records.back()->record = core.texts.get(value)->id;
        }
        return Py_NewRef(held.object);
    });
}
void unmake(PyObject* self) {
    PyTypeObject* type = Py_TYPE(self);
    delete reinterpret_cast<CoreObject*>(self)->core;
    type->tp_free(self);
    Py_DECREF(type);
}

#define METHOD(name, count) \
    {#name, reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(method<name, count>)), METH_FASTCALL, nullptr}
PyMethodDef METHODS[] = {
    METHOD(add_node, 4), METHOD(add_edge, 5), METHOD(write_node, 3), METHOD(write_edge, 5), METHOD(remove_node, 1),
    METHOD(remove_edge, 3), METHOD(get_node, 2), METHOD(get_edge, 4), METHOD(nodes, 1), METHOD(take, 0),
    METHOD(receive, 3), METHOD(join, 2), METHOD(join_piece, 2), METHOD(pieces, 0), METHOD(watch, 0), METHOD(waits, 0),
    METHOD(changes, 0),
    METHOD(poses, 3), METHOD(state, 0), {nullptr, nullptr, 0, nullptr},
};
PyType_Slot SLOTS[] = {
    {Py_tp_new, reinterpret_cast<void*>(make)}, {Py_tp_dealloc, reinterpret_cast<void*>(unmake)},
    {Py_tp_methods, METHODS}, {0, nullptr},
};
PyType_Spec SPEC = {"compiled_core.Core", sizeof(CoreObject), 0, Py_TPFLAGS_DEFAULT, SLOTS};
PyModuleDef MODULE = {PyModuleDef_HEAD_INIT, "compiled_core", nullptr, -1, nullptr, nullptr, nullptr, nullptr, nullptr};

}  // namespace

PyMODINIT_FUNC PyInit_compiled_core() {
    PyObject* module = PyModule_Create(&MODULE);
    PyObject* type = module ? PyType_FromSpec(&SPEC) : nullptr;
    if (!type || PyModule_AddObjectRef(module, "Core", type)) { Py_XDECREF(module); module = nullptr; }
    Py_XDECREF(type);
    return module;
}
