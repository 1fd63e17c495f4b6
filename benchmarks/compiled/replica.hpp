// One replica: the store, what is shown of it, what is told and sent, and the messages that it reads and writes.

#pragma once

#include "elements.hpp"

namespace {

struct Core {
    Names<Replica> replicas;
    Names<Text> texts;
    std::vector<Text*> records;
    Replica* self = nullptr;
    Text* pose = nullptr;
    PyObject* make_pose = nullptr;
    uint64_t counter = 0, latest = 0, fingerprint = 0, messages = 0, batch = 1;
    std::vector<std::unique_ptr<Element>> elements;
    std::unordered_map<EdgeKey, Element*, EdgeHash> edges;
    std::vector<Entry*> unattached, gone;
    std::unordered_map<Dot, std::vector<Write>, DotHash> waiting;
    size_t waiting_weight = 0;
    bool watched = false;
    std::vector<Pending> pending;
    std::vector<Delta> bundles = std::vector<Delta>(1);
    std::vector<Write> samples;
    Out scratch;

    ~Core() {
        for (auto& rid : replicas.all) for (auto& made : rid->made) delete made.second;
        free_gone();
        Py_XDECREF(make_pose);
    }
    void free_gone() {
        for (Entry* entry : gone) delete entry;
        gone.clear();
    }

    // ---- elements

    Element* node(Text* name) {
        if (!name->node) {
            elements.push_back(std::make_unique<Element>());
            name->node = elements.back().get();
            name->node->name = name;
        }
        return name->node;
    }
    Element* edge(const EdgeKey& key) {
        Element*& found = edges[key];
        if (!found) {
            elements.push_back(std::make_unique<Element>());
            found = elements.back().get();
            found->source = key.source;
            found->destination = key.destination;
            found->name = key.type;
        }
        return found;
    }
    bool is_there(const Text* name, const std::vector<Dot>& dots) {
        for (const Dot& dot : dots) {
            Entry* entry = dot.rid->find(dot.counter);
            if (entry && entry->element->is_node() && entry->element->name == name) return true;
        }
        return false;
    }
    bool has_ends(const Entry* entry) {
        const Element* edge = entry->element;
        return is_there(edge->source, entry->sources) && is_there(edge->destination, entry->destinations);
    }
    bool is_gone(const Text* name, const std::vector<Dot>& dots) {
        for (const Dot& dot : dots) if (!dot.rid->covers(dot.counter)) return false;
        return !is_there(name, dots);
    }
    bool is_dead(const Entry* entry) {
        const Element* edge = entry->element;
        return is_gone(edge->source, entry->sources) || is_gone(edge->destination, entry->destinations);
    }
    static Register* winner(const Element* element, const Text* attribute, Entry** owner = nullptr) {
        Register* best = nullptr;
        Entry* from = nullptr;
        for (Entry* entry : element->seen) {
            Register* one = entry->find(attribute);
            if (!one) continue;
            if (!best || best->stamp < one->stamp ||
                (best->stamp == one->stamp && (best->writer->id < one->writer->id ||
                                               (best->writer == one->writer && from->dot < entry->dot)))) {
                best = one;
                from = entry;
            }
        }
        if (owner) *owner = from;
        return best;
    }
    static Text* type_of(const std::vector<Entry*>& entries) {
        Entry* greatest = entries[0];
        for (Entry* entry : entries) if (greatest->dot < entry->dot) greatest = entry;
        return greatest->type;
    }
    void enter(Element* element, Text* type) {
        std::vector<Element*>& group = element->is_node() ? type->nodes : type->edges;
        element->type = type;
        element->place = group.size();
        group.push_back(element);
    }
    static void leave(Element* element) {
        std::vector<Element*>& group = element->is_node() ? element->type->nodes : element->type->edges;
        group.back()->place = element->place;
        group[element->place] = group.back();
        group.pop_back();
    }

    // ---- what watches and frames are told

    Pending* offer(Element* element, char kind) {
        if (!watched) return nullptr;
        if (!element->pending) {
            pending.push_back({element});
            element->pending = pending.size();
        }
        Pending& one = pending[element->pending - 1];
        if (kind == 'u' && one.count && one.changes[one.count - 1].kind != 'r') return &one;
        if (kind == 'a') one.attributes.clear();
        one.changes[one.count++] = {kind, element->type};
        if (one.count == 3) {
            int drop = one.changes[0].kind == 'u' ? 1 : 2;
            std::copy(one.changes + drop, one.changes + 3, one.changes);
            one.count -= drop;
        }
        return &one;
    }
    static void touch(Pending* one, Text* attribute) {
        if (std::find(one->attributes.begin(), one->attributes.end(), attribute) == one->attributes.end())
            one->attributes.push_back(attribute);
    }
    void added(Element* element) {
        if (!element->is_node()) note_pose(element);
        Pending* one = offer(element, 'a');
        for (Entry* entry : one ? element->seen : std::vector<Entry*>())
            for (const Register& held : entry->registers)
                if (winner(element, held.attribute)->value.is_set()) touch(one, held.attribute);
    }
    void removed(Element* element) {
        if (!element->is_node()) element->poses.clear();
        offer(element, 'r');
    }
    void updated(Element* element, Text* attribute) {
        if (attribute == pose && !element->is_node()) note_pose(element);
        if (Pending* one = offer(element, 'u')) touch(one, attribute);
    }
    void note_pose(Element* edge) {
        if (!edge->name->geometric) return;
        Register* write = winner(edge, pose);
        if (!write || !write->value.is_set() || *write->value.begin() != 0xc7) { edge->poses.clear(); return; }
        Sample sample;
        memcpy(sample.data(), write->value.begin() + 3, POSE_BYTES);
        follow(edge->poses, sample);
    }
    static void follow(std::vector<Sample>& poses, const Sample& sample) {
        auto before = [](const Sample& one, double stamp) { return one[7] < stamp; };
        double stamp = sample[7];
        if (poses.empty()) { poses.push_back(sample); return; }
        double newest = poses.back()[7];
        if (stamp < newest) {
            poses.erase(std::lower_bound(poses.begin(), poses.end(), stamp, before), poses.end());
            poses.push_back(sample);
        } else if (stamp == 0.0 || newest == 0.0) {
            if (sample != poses.back()) poses.assign(1, sample);
        } else if (stamp == newest) {
            poses.back() = sample;
        } else {
            poses.push_back(sample);
            size_t old = poses.size() > SAMPLES ? poses.size() - SAMPLES : 0;
            if (old || poses[0][7] < stamp - HISTORY)
                poses.erase(poses.begin(), std::lower_bound(poses.begin() + old, poses.end(), stamp - HISTORY, before));
        }
    }

    // ---- what is shown

    void show_others(Element* element, std::vector<Entry*> entries) {  // other incarnations of what was visible
        std::vector<std::pair<Text*, Value>> before;
        auto all = [&](auto visit) {
            for (Entry* entry : element->seen) for (Register& one : entry->registers) visit(one.attribute);
        };
        all([&](Text* name) { before.emplace_back(name, winner(element, name)->value); });
        element->seen = std::move(entries);
        all([&](Text* name) { before.emplace_back(name, Value()); });
        std::vector<Text*> looked;
        for (auto& [name, value] : before) {
            if (std::find(looked.begin(), looked.end(), name) != looked.end()) continue;
            looked.push_back(name);
            Register* now = winner(element, name);
            if (!(now ? now->value : Value()).is_same(value)) updated(element, name);
        }
    }
    void show(Element* element) {
        std::vector<Entry*> entries;
        for (Entry* entry : element->live) if (element->is_node() || has_ends(entry)) entries.push_back(entry);
        bool was_seen = !element->seen.empty();
        if (was_seen && entries.empty()) {
            removed(element);
            leave(element);
            element->seen.clear();
        } else if (!entries.empty()) {
            Text* type = element->is_node() ? type_of(entries) : element->name;
            if (was_seen && type == element->type) { show_others(element, std::move(entries)); return; }
            if (was_seen) { removed(element); leave(element); }
            element->seen = std::move(entries);
            enter(element, type);
            added(element);
        }
    }
    void note_incident(Element* edge, bool is_new) {
        for (Text* end : {edge->source, edge->destination}) {
            std::vector<Element*>& edges_there = node(end)->incident;
            if (is_new && (end == edge->source || edge->source != edge->destination)) edges_there.push_back(edge);
        }
    }
    void entries_added(Element* element, const std::vector<Entry*>& group) {
        bool is_new = element->live.size() == group.size();
        if (element->is_node()) {
            show(element);
            std::vector<Element*> at = element->incident;
            for (Element* edge : at) if (is_new || edge->seen.empty() || edge->live.size() > 1) show(edge);
            return;
        }
        note_incident(element, is_new);
        std::vector<Entry*> open;
        for (Entry* entry : group) if (!has_ends(entry)) open.push_back(entry);
        if (open.size() < group.size()) show(element);
        for (Entry* entry : open) {
            if (is_dead(entry)) remove({entry->dot});
            else await(entry);
        }
    }
    void await(Entry* entry) {
        if (!entry->unattached) { entry->unattached = true; unattached.push_back(entry); }
    }
    void entries_removed(Element* element, const std::vector<Entry*>& group) {
        if (element->is_node()) {
            std::vector<Element*> at = element->incident;
            if (!element->live.empty()) {  // others are left, and so are edges that are bound to those alone
                auto is_bound = [&](const std::vector<Dot>& dots) {
                    return std::any_of(dots.begin(), dots.end(), [&](const Dot& dot) {
                        return std::any_of(group.begin(), group.end(), [&](Entry* entry) { return entry->dot == dot; });
                    });
                };
                auto stays = [&](Element* edge) {
                    return std::none_of(edge->live.begin(), edge->live.end(), [&](Entry* entry) {
                        return is_bound(entry->sources) || is_bound(entry->destinations);
                    });
                };
                at.erase(std::remove_if(at.begin(), at.end(), stays), at.end());
            }
            for (Element* edge : at) show(edge);
            show(element);
            std::vector<Dot> dead;
            for (Element* edge : at) for (Entry* entry : edge->live) {
                if (has_ends(entry)) continue;
                if (is_dead(entry)) dead.push_back(entry->dot);
                else await(entry);
            }
            remove(dead);
            return;
        }
        for (Entry* entry : group)
            if (entry->unattached) unattached.erase(std::find(unattached.begin(), unattached.end(), entry));
        if (element->live.empty()) {
            for (Text* end : {element->source, element->destination}) {
                std::vector<Element*>& at = node(end)->incident;
                auto found = std::find(at.begin(), at.end(), element);
                if (found != at.end()) at.erase(found);
            }
        }
        show(element);
    }
    void look_again() {
        std::vector<Entry*> waiting_edges = std::move(unattached);
        unattached.clear();
        std::vector<Dot> dead;
        for (Entry* entry : waiting_edges) {
            entry->unattached = false;
            if (has_ends(entry)) continue;
            if (is_dead(entry)) dead.push_back(entry->dot);
            else await(entry);
        }
        remove(dead);
    }

    // ---- the store

    Entry* add(Add&& add) {
        if (add.dot.rid->find(add.dot.counter) || add.dot.rid->covers(add.dot.counter)) return nullptr;
        Element* element = add.key.destination ? edge(add.key) : node(add.key.source);
        Entry* entry = new Entry{add.dot, element, add.type, std::move(add.sources), std::move(add.destinations), {}};
        auto& made = add.dot.rid->made;
        if (made.empty() || made.back().first < add.dot.counter) made.emplace_back(add.dot.counter, entry);
        else made.insert(add.dot.rid->place(add.dot.counter), {add.dot.counter, entry});
        element->live.push_back(entry);
        fingerprint ^= dot_hash(add.dot);
        if (!waiting.empty()) {
            auto found = waiting.find(add.dot);
            if (found != waiting.end()) {
                std::vector<Write> writes = std::move(found->second);
                waiting.erase(found);
                for (Write& write : writes) {
                    waiting_weight -= weight(write);
                    Dot dot = write.dot;
                    set(entry, write);
                    if (dot.rid) dot.rid->see(dot.counter, dot.counter);
                }
            }
        }
        return entry;
    }
    Register* set(Entry* entry, Write& write) {
        Register* held = entry->find(write.attribute);
        if (!held) {
            entry->registers.push_back({write.attribute});
            held = &entry->registers.back();
        } else if (write.stamp <= held->stamp) {
            if (write.stamp < held->stamp) return nullptr;
            if (write.writer == held->writer) {  // the same again, now durable, or by two replicas
                if (write.dot.rid && (!held->dot.rid || held->dot < write.dot)) held->dot = write.dot;
                return nullptr;
            }
            if (write.writer->id < held->writer->id) return nullptr;
        }
        held->stamp = write.stamp;
        held->writer = write.writer;
        held->dot = write.dot;
        held->value = std::move(write.value);
        if (entry->announced) {
            Element* element = entry->element;
            auto& seen = element->seen;
            if (seen.size() == 1 ? seen[0] == entry : std::find(seen.begin(), seen.end(), entry) != seen.end())
                updated(element, write.attribute);
        }
        return held;
    }
    static size_t weight(const Write& write) { return 1 + length_of(write.value).second / 100; }
    bool wait(Write&& write) {  // false if its dot must not yet count as seen
        if (write.owner.rid->covers(write.owner.counter) || !write.dot.rid) return true;
        if (waiting_weight < MAX_WAITING) {
            waiting_weight += weight(write);
            Dot owner = write.owner;
            waiting[owner].push_back(std::move(write));
        }
        return false;
    }
    void forget_waiting(const Dot& dot) {
        auto found = waiting.find(dot);
        if (found == waiting.end()) return;
        for (Write& write : found->second) {
            waiting_weight -= weight(write);
            if (write.dot.rid) write.dot.rid->see(write.dot.counter, write.dot.counter);
        }
        waiting.erase(found);
    }
    void remove(const std::vector<Dot>& dots) {
        std::vector<Entry*> taken;
        for (const Dot& dot : dots) {
            dot.rid->see(dot.counter, dot.counter);
            if (!waiting.empty()) forget_waiting(dot);
            auto found = dot.rid->place(dot.counter);
            if (found == dot.rid->made.end() || found->first != dot.counter) continue;
            Entry* entry = found->second;
            dot.rid->made.erase(found);
            auto& live = entry->element->live;
            live.erase(std::find(live.begin(), live.end(), entry));
            fingerprint ^= dot_hash(dot);
            taken.push_back(entry);
            gone.push_back(entry);
        }
        by_element(taken, [&](Element* element, const std::vector<Entry*>& group) { entries_removed(element, group); });
    }
    template <class F> static void by_element(const std::vector<Entry*>& entries, F act) {  // nodes before edges
        if (entries.size() == 1) { act(entries[0]->element, entries); return; }
        std::vector<std::pair<Element*, std::vector<Entry*>>> groups;
        std::unordered_map<Element*, size_t> places;
        for (Entry* entry : entries) {
            size_t place = places.emplace(entry->element, groups.size()).first->second;
            if (place == groups.size()) groups.push_back({entry->element, {}});
            groups[place].second.push_back(entry);
        }
        for (bool nodes : {true, false})
            for (auto& [element, group] : groups) if (element->is_node() == nodes) act(element, group);
    }
    void announce(const std::vector<Entry*>& entries) {
        for (Entry* entry : entries) entry->dot.rid->see(entry->dot.counter, entry->dot.counter);
        std::vector<Entry*> group;
        for (bool nodes : {true, false}) for (Entry* entry : entries) {
            if (entry->element->is_node() != nodes || entry->announced) continue;
            if (!entry->dot.rid->find(entry->dot.counter)) continue;  // a dead edge, dropped meanwhile
            group.clear();
            for (Entry* one : entry->element->live) if (!one->announced) group.push_back(one);
            for (Entry* one : group) one->announced = true;
            entries_added(entry->element, group);
        }
    }
    void join(Delta& delta, double now) {
        heed(delta.writes, now);
        if (delta.is_reply) remove(absent(delta));
        if (!delta.removed.empty()) remove(delta.removed);
        std::vector<Entry*> fresh;
        for (Add& one : delta.adds) if (Entry* entry = add(std::move(one))) fresh.push_back(entry);
        std::vector<Dot> held_back;
        Entry* entry = nullptr;
        for (size_t at = 0; at < delta.writes.size(); ++at) {
            Write& write = delta.writes[at];
            if (!entry || !(entry->dot == write.owner)) {
                entry = write.owner.rid->find(write.owner.counter);
                size_t next = at;
                if (entry && entry->registers.empty())
                    while (next < delta.writes.size() && delta.writes[next].owner == write.owner) ++next;
                if (entry) entry->registers.reserve(next - at);
            }
            Dot dot = write.dot;
            if (entry) set(entry, write);
            else if (!wait(std::move(write)) && dot.rid) held_back.push_back(dot);
        }
        learn(delta.context, held_back);
        if (delta.is_reply && !waiting.empty()) {
            std::vector<Dot> known;
            for (auto& one : waiting) if (one.first.rid->covers(one.first.counter)) known.push_back(one.first);
            for (const Dot& dot : known) forget_waiting(dot);
        }
        if (!fresh.empty()) announce(fresh);
        if (!unattached.empty() && (!delta.context.empty() || !delta.removed.empty())) look_again();
        free_gone();
    }
    std::vector<Dot> absent(Delta& delta) {  // what is held here, and the sender has seen and does not hold
        std::vector<Dot> found;
        bool is_sorted = false;
        for (const Seen& one : delta.examined)
            for (auto at = one.rid->place(one.first); at != one.rid->made.end() && at->first <= one.last; ++at) {
                if (!is_sorted) std::sort(delta.live.begin(), delta.live.end());
                is_sorted = true;
                Dot dot{one.rid, at->first};
                if (!std::binary_search(delta.live.begin(), delta.live.end(), dot)) found.push_back(dot);
            }
        return found;
    }
    static void learn(const std::vector<Seen>& context, std::vector<Dot>& held_back) {
        std::sort(held_back.begin(), held_back.end());
        for (const Seen& one : context) {
            uint64_t first = one.first;
            for (const Dot& hole : held_back)
                if (hole.rid == one.rid && hole.counter >= first && hole.counter <= one.last) {
                    one.rid->see(first, hole.counter - 1);
                    first = hole.counter + 1;
                }
            one.rid->see(first, one.last);
        }
    }
    uint64_t tick(double now) {
        uint64_t stamp = stamp_at(now);
        return latest = stamp <= latest ? latest + 1 : stamp;
    }
    void heed(const std::vector<Write>& writes, double now) {
        uint64_t limit = stamp_at(now + MAX_LEAD);
        for (const Write& write : writes) if (write.stamp <= limit) latest = std::max(latest, write.stamp);
    }

    // ---- local changes

    void commit(const std::vector<Entry*>& owners, Entry* fresh, Given& values, double now) {
        uint64_t first = counter + (fresh ? 0 : 1), stamp = tick(now);
        std::vector<uint64_t> stamps(values.size(), stamp);
        for (size_t i = 0; i < values.size() && !fresh; ++i)  // all before the first dot: one may have no room
            for (Entry* owner : owners)
                if (Register* held = owner->find(values[i].first)) {
                    if (held->stamp >= MAX_STAMP) throw LeftToPython{"no room beyond the greatest stamp"};
                    stamps[i] = std::max(stamps[i], held->stamp + 1);
                }
        if (bundles.back().writes.size() + bundles.back().adds.size() >= BUNDLE) bundles.emplace_back();
        Delta& bundle = bundles.back();
        if (fresh) fresh->registers.reserve(values.size());
        for (size_t i = 0; i < values.size(); ++i) {
            Text* attribute = values[i].first;
            bool stream = !fresh && values[i].second.is_set() && attribute->stream;
            for (Entry* owner : owners) {
                Dot dot = stream ? Dot{} : Dot{self, ++counter};
                Write write{owner->dot, attribute, stamps[i], self, dot, values[i].second};
                if (!stream) bundle.writes.push_back(write);
                Register* held = set(owner, write);
                if (stream) keep_sample(held, {owner->dot, attribute, stamps[i], self, dot, values[i].second});
            }
        }
        if (counter >= first) account(bundle, first);
        if (fresh) {
            EdgeKey key = key_of(fresh->element);
            bundle.adds.push_back({fresh->dot, key, fresh->type, fresh->sources, fresh->destinations});
            announce({fresh});
        }
    }
    void account(Delta& bundle, uint64_t first) {
        self->see(first, counter);
        if (!bundle.context.empty() && bundle.context.back().last + 1 == first) bundle.context.back().last = counter;
        else bundle.context.push_back({self, first, counter});
    }
    void keep_sample(Register* held, Write&& write) {
        if (held->batch == batch) { samples[held->sample] = std::move(write); return; }
        held->batch = batch;
        held->sample = samples.size();
        samples.push_back(std::move(write));
    }
    static EdgeKey key_of(const Element* element) {
        if (element->is_node()) return {element->name};
        return {element->source, element->destination, element->name};
    }
    void put(const EdgeKey& key, Text* type, Given& values, double now) {  // create, or write to what is visible
        Element* element = key.destination ? edge(key) : node(key.source);
        if (!element->seen.empty()) {
            if (element->type != type) throw Refused{"there under another type"};
            commit(std::vector<Entry*>(element->live), nullptr, values, now);
            return;
        }
        Add one{{self, 0}, key, type};
        if (key.destination) { one.sources = ends_at(key.source); one.destinations = ends_at(key.destination); }
        one.dot.counter = ++counter;
        Entry* entry = add(std::move(one));
        commit({entry}, entry, values, now);
        free_gone();
    }
    std::vector<Dot> ends_at(Text* name) {
        Element* there = node(name);
        if (there->seen.empty()) throw Refused{"no such node"};
        if (there->seen.size() > MAX_ENDS) throw LeftToPython{"an end with very many creation dots"};
        std::vector<Dot> dots;
        for (Entry* entry : there->seen) dots.push_back(entry->dot);
        return dots;
    }
    void take_away(Element* element) {
        if (element->seen.empty()) return;
        std::vector<Dot> dots;
        for (Entry* entry : element->live) dots.push_back(entry->dot);
        for (Element* edge : element->incident) for (Entry* entry : edge->live) dots.push_back(entry->dot);
        ++counter;
        remove(dots);
        if (bundles.back().writes.size() + bundles.back().adds.size() >= BUNDLE) bundles.emplace_back();
        Delta& bundle = bundles.back();
        bundle.removed.insert(bundle.removed.end(), dots.begin(), dots.end());
        account(bundle, counter);
        free_gone();
    }

    // ---- reading messages

    std::vector<Replica*> read_names(In& in) {
        std::vector<Replica*> names;
        for (size_t n = in.array(); n; --n) names.push_back(replicas.get(in.text(1, MAX_NAME)));
        return names;
    }
    static Replica* read_replica(In& in, const std::vector<Replica*>& names) {
        size_t index = in.natural();
        if (index >= names.size()) throw Refused{"an index of no replica"};
        return names[index];
    }
    static std::vector<Dot> read_dots(In& in, const std::vector<Replica*>& names) {
        size_t n = in.array();
        if (n % 2) throw Refused{"dots are pairs"};
        std::vector<Dot> dots;
        dots.reserve(n / 2);
        for (; n; n -= 2) { Replica* rid = read_replica(in, names); dots.push_back({rid, in.natural(1)}); }
        return dots;
    }
    static std::vector<Seen> read_ranges(In& in, const std::vector<Replica*>& names) {
        size_t n = in.array();
        if (n % 3) throw Refused{"ranges are triples"};
        std::vector<Seen> ranges;
        for (; n; n -= 3) {
            Replica* rid = read_replica(in, names);
            uint64_t first = in.natural(1, MAX_COUNTER);
            ranges.push_back({rid, first, in.natural(first, MAX_COUNTER)});
        }
        return ranges;
    }
    bool is_own_name(const std::string& name, const Text* type) {
        if (!type->record.empty()) return name.compare(0, type->record.size(), type->record) == 0;
        return std::none_of(records.begin(), records.end(), [&](Text* record) {
            return name.compare(0, record->record.size(), record->record) == 0;
        });
    }
    void read_changes(In& in, const std::vector<Replica*>& names, Delta& delta) {
        size_t n = in.array();
        for (delta.adds.reserve(n); n; --n) {
            in.fields(6);
            Add one;
            one.dot.rid = read_replica(in, names);
            one.dot.counter = in.natural(1, MAX_COUNTER);
            bool is_edge = in.at < in.end && (*in.at & 0xf0) == 0x90;
            if (is_edge) in.fields(3);
            one.key = {texts.get(in.text(1, MAX_NAME))};
            if (is_edge) {
                one.key.destination = texts.get(in.text(1, MAX_NAME));
                one.key.type = texts.get(in.text(1, MAX_NAME));
            }
            one.type = texts.get(in.text(1, MAX_NAME));
            one.sources = read_dots(in, names);
            one.destinations = read_dots(in, names);
            bool has_ends = !one.sources.empty() && !one.destinations.empty() && one.sources.size() <= MAX_ENDS &&
                            one.destinations.size() <= MAX_ENDS;
            bool is_node = one.sources.empty() && one.destinations.empty() && is_own_name(one.key.source->id, one.type);
            if (!(is_edge ? has_ends : is_node))
                throw Refused{"an addition with wrong ends, or a name that is the graph's own"};
            delta.adds.push_back(std::move(one));
        }
        n = in.array();
        for (delta.writes.reserve(n); n; --n) {
            in.fields(8);
            Write one;
            one.owner.rid = read_replica(in, names);
            one.owner.counter = in.natural(1, MAX_COUNTER);
            one.attribute = texts.get(in.text(1, MAX_NAME));
            one.stamp = in.natural();
            one.writer = read_replica(in, names);
            Replica* rid = read_replica(in, names);
            one.dot.counter = in.natural(0, MAX_COUNTER);
            one.dot.rid = one.dot.counter ? rid : nullptr;
            one.value = in.value(scratch);
            delta.writes.push_back(std::move(one));
        }
    }
    Delta read_delta(In in) {
        Delta delta;
        in.fields(7);
        in.natural(1, 1);
        std::vector<Replica*> names = read_names(in);
        read_changes(in, names, delta);
        delta.removed = read_dots(in, names);
        delta.context = read_ranges(in, names);
        delta.is_reply = !in.nil();
        if (delta.is_reply) { delta.live = read_dots(in, names); delta.examined = delta.context; }
        if (in.at != in.end) throw Refused{"more than a message"};
        return delta;
    }
    Delta read_piece(In in) {
        Delta delta;
        in.fields(11);
        in.natural(1, 1);
        std::vector<Replica*> names = read_names(in);
        read_changes(in, names, delta);
        delta.live = read_dots(in, names);
        delta.examined = read_ranges(in, names);
        delta.is_reply = true;
        if (!in.nil()) read_ranges(in, names);
        for (int i = 0; i < 2; ++i) {
            if (i && in.nil()) break;
            in.fields(3);
            in.text(0, MAX_NAME);
            in.natural(0, MAX_COUNTER);
            in.text(0, MAX_NAME);
        }
        in.boolean();
        for (size_t n = in.array(); n; --n) in.text(1, MAX_NAME);
        if (in.at != in.end) throw Refused{"more than a message"};
        std::vector<Dot> dots;
        for (const Add& one : delta.adds) { dots.push_back(one.dot); delta.live.push_back(one.dot); }
        size_t middle = dots.size();
        for (const Write& one : delta.writes) if (one.dot.rid) dots.push_back(one.dot);
        if (std::is_sorted(dots.begin(), dots.begin() + middle) && std::is_sorted(dots.begin() + middle, dots.end()))
            std::inplace_merge(dots.begin(), dots.begin() + middle, dots.end());
        else std::sort(dots.begin(), dots.end());
        for (const Dot& dot : dots) {
            Seen* last = delta.context.empty() ? nullptr : &delta.context.back();
            if (last && last->rid == dot.rid && last->last + 1 >= dot.counter) last->last = dot.counter;
            else delta.context.push_back({dot.rid, dot.counter, dot.counter});
        }
        return delta;
    }
    bool is_plain(Replica* sender, const Delta& delta) {  // see dsr/replication/claims.py
        if (!delta.removed.empty() || delta.is_reply || sender == self) return false;
        uint64_t first = 1, last = 0;
        if (!delta.context.empty()) {
            const Seen& one = delta.context[0];
            bool follows = sender->known && one.first <= sender->known + 1;
            if (delta.context.size() > 1 || one.rid != sender || !follows) return false;
            first = one.first;
            last = one.last;
        }
        auto is_own = [&](const Dot& dot) { return dot.rid == sender && dot.counter >= first && dot.counter <= last; };
        return std::all_of(delta.adds.begin(), delta.adds.end(), [&](const Add& one) { return is_own(one.dot); }) &&
               std::all_of(delta.writes.begin(), delta.writes.end(),
                           [&](const Write& one) { return !one.dot.rid || is_own(one.dot); });
    }

    // ---- writing messages

    PyObject* encoded(const Delta& delta) {
        Message message(++messages);
        message.body.array(delta.adds.size());
        for (const Add& one : delta.adds) message.add(one.dot, one.key, one.type, one.sources, one.destinations);
        message.body.array(delta.writes.size());
        for (const Write& one : delta.writes) message.write(one.owner, one);
        message.dots(delta.removed);
        message.ranges(delta.context);
        message.body.byte(0xc0);
        return message.finished(7);
    }
    PyObject* piece(const std::vector<Entry*>& all, size_t begin, size_t& end) {
        Message message(++messages);
        size_t weight = 0, writes = 0;
        for (end = begin; end < all.size() && end - begin < MAX_EXAMINED && weight < MAX_WEIGHT; ++end) {
            size_t total = 0;
            for (const Register& one : all[end]->registers) {
                auto [is_vector, length] = length_of(one.value);
                total += BYTES_OF_CHANGE + (is_vector ? 9 : 1) * length;
            }
            if (total > MAX_WEIGHT) throw LeftToPython{"an element that fills several pieces"};
            weight += BYTES_OF_CHANGE + total;
            writes += all[end]->registers.size();
        }
        message.body.array(end - begin);
        for (size_t i = begin; i < end; ++i)
            message.add(all[i]->dot, key_of(all[i]->element), all[i]->type, all[i]->sources, all[i]->destinations);
        message.body.array(writes);
        for (size_t i = begin; i < end; ++i)
            for (const Register& one : all[i]->registers) message.write(all[i]->dot, one);
        message.dots({});
        static const std::string nobody;
        const std::string& from = begin ? all[begin]->dot.rid->id : nobody;
        std::vector<Seen> whole, examined;
        for (auto& rid : replicas.all) if (rid->known) whole.push_back({rid.get(), 1, rid->known});
        for (auto& rid : replicas.all)
            for (const Range& one : rid->beyond) whole.push_back({rid.get(), one.first, one.last});
        for (Seen one : whole) {
            if (begin && one.rid == all[begin]->dot.rid) one.first = std::max(one.first, all[begin]->dot.counter);
            const Dot* stop = end < all.size() ? &all[end]->dot : nullptr;
            if (stop && one.rid == stop->rid) one.last = std::min(one.last, stop->counter - 1);
            if (one.rid->id >= from && (!stop || one.rid->id <= stop->rid->id) && one.first <= one.last)
                examined.push_back(one);
        }
        message.ranges(examined);
        if (begin) message.body.byte(0xc0);
        else message.ranges(whole);
        auto place = [&](size_t at) {
            message.body.array(3);
            message.body.text(at ? all[at]->dot.rid->id : nobody);
            message.body.natural(at ? all[at]->dot.counter : 0);
            message.body.text("");
        };
        place(begin);
        if (end < all.size()) place(end);
        else message.body.byte(0xc0);
        message.body.byte(0xc3);
        message.body.array(0);
        return message.finished(11);
    }
};

}  // namespace
