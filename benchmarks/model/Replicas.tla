------------------------------ MODULE Replicas ------------------------------
(* How replicas of the working memory join, remove and repair, for a checker to explore: every order of messages, each *)
(* lost, late or repeated, with restarts and answers in pieces that may be broken off.                                 *)
(*                                                                                                                     *)
(* The rules are those of dsr.crdt.store (Join), dsr.graph.graph (Bury), dsr.crdt.pieces (PieceOf) and                 *)
(* dsr.replication.sync (Deliver, Ask). Left out are samples of streams, forged messages, access rights, bounds, and   *)
(* the choice of whom to ask and when. `python -m benchmarks.model` checks it, and makes traces for the real code.     *)
EXTENDS Integers, FiniteSets, Sequences

CONSTANTS
    Sites,      \* places, 1..n: each runs one replica after the other
    Changes,    \* additions, writes and removals in a history
    Fetches,    \* answers that are begun
    Restarts,   \* processes that die; another one starts in their place
    Edges,      \* whether there are edges: from the node to itself
    Wrong,      \* name of the rule that is left out; "" for none
    Script      \* actions to be taken, one after the other; Anything for all that are possible

VARIABLES
    site,       \* what each replica holds
    msgs,       \* every delta that was ever sent; whoever gets one keeps it here for others, and for another time
    born,       \* what was created under each creation dot: its key, and the incarnations of the node that an edge is at
    removals,   \* what was removed under each dot of a removal
    left,       \* changes, fetches and restarts that are left
    last,       \* the action that led here
    count       \* actions so far

vars == <<site, msgs, born, removals, left, last, count>>
view == <<site, msgs, born, removals, left>>

Anything == <<>>
None == [at |-> <<0, 0>>, of |-> 0, from |-> 0, seen |-> {}, whole |-> {}, held |-> {}, joined |-> FALSE]
Before(a, b) == a[1] < b[1] \/ (a[1] = b[1] /\ a[2] < b[2])
Greatest(set) == CHOOSE x \in set : \A y \in set : y <= x
First(dots) == CHOOSE d \in dots : \A e \in dots : d = e \/ Before(d, e)
Dots(writes) == {w.dot : w \in writes}
Wins(v, w) == v.stamp > w.stamp \/ (v.stamp = w.stamp /\ v.dot[1] > w.dot[1])
KeyOf(d) == born[d].key

Fresh(rid) == [rid |-> rid, n |-> 0, clock |-> 0, seen |-> {}, live |-> {}, regs |-> {}, waits |-> {},
               joined |-> FALSE, fetch |-> None]

Init ==
    /\ site = [s \in Sites |-> [Fresh(s) EXCEPT !.joined = TRUE]]
    /\ msgs = {}
    /\ born = <<>>
    /\ removals = <<>>
    /\ left = [changes |-> Changes, fetches |-> Fetches, restarts |-> Restarts]
    /\ last = [do |-> "start", site |-> 0, with |-> <<>>]
    /\ count = 0

(* ---- the store ---- *)

Delta(adds, writes, removed, dots) ==
    [adds |-> adds, writes |-> writes, removed |-> removed, dots |-> dots,
     answer |-> FALSE, kept |-> {}, examined |-> {}]

\* Edges that no replica can ever show again: all incarnations of an end were removed.
Dead(r) == {d \in r.live : born[d].key = "e" /\ \A a \in born[d].ends : a \in r.seen /\ a \notin r.live}

Bury(r) ==
    IF Wrong = "dead edges are kept" THEN r
    ELSE [r EXCEPT !.live = @ \ Dead(r), !.regs = {w \in @ : w.owner \notin Dead(r)}]

Winner(writes, owner) ==
    LET of == {w \in writes : w.owner = owner}
    IN CHOOSE w \in of : \A v \in of : v = w \/ Wins(w, v)

\* Join a delta or an answer; the order of the steps is that of Store.join.
Join(r, d) ==
    LET absent == IF d.answer /\ Wrong # "answers remove nothing" THEN {x \in r.live : x \in d.examined /\ x \notin d.kept} ELSE {}
        gone == absent \union d.removed
        void == {w \in r.waits : w.owner \in gone}
        seen1 == IF Wrong = "removals that come first are forgotten"
                 THEN r.seen \union (gone \intersect r.live) \union Dots(void)
                 ELSE r.seen \union gone \union Dots(void)
        live1 == r.live \ gone
        new == {x \in d.adds : x \notin live1 /\ (x \notin seen1 \/ Wrong = "late additions resurrect")}
        live2 == live1 \union new
        woken == {w \in r.waits \ void : w.owner \in new}
        seen2 == seen1 \union Dots(woken)
        applied == {w \in d.writes : w.owner \in live2}
        early == {w \in d.writes : w.owner \notin live2 /\ w.owner \notin seen2}
        held == IF Wrong = "writes that came too early count as seen" THEN {} ELSE Dots(early)
        seen3 == seen2 \union (d.dots \ held)
        waits == ((r.waits \ void) \ woken) \union early
        late == IF d.answer THEN {w \in waits : w.owner \in seen3} ELSE {}
        writes == {w \in r.regs : w.owner \in live2} \union woken \union applied
        owners == {w.owner : w \in writes}
        regs == IF Wrong = "the last to arrive wins"
                THEN {w \in writes : w \in applied \/ w.owner \notin {v.owner : v \in applied}}
                ELSE {Winner(writes, o) : o \in owners}
    IN Bury([r EXCEPT
            !.live = live2, !.regs = regs, !.waits = waits \ late,
            !.seen = seen3 \union new \union Dots(late),
            !.clock = IF d.writes = {} THEN @ ELSE Greatest({@} \union {w.stamp : w \in d.writes})])

(* ---- what users do ---- *)

Nodes(r) == {d \in r.live : KeyOf(d) = "a"}
EdgesOf(r) == {d \in r.live : KeyOf(d) = "e"}
Shown(r) == {d \in EdgesOf(r) : born[d].ends \intersect r.live # {}}

Act(do, s, with) == [do |-> do, site |-> s, with |-> with]

Commit(s, r, d, do) ==
    /\ left.changes > 0
    /\ left' = [left EXCEPT !.changes = @ - 1]
    /\ site' = [site EXCEPT ![s] = r]
    /\ msgs' = msgs \union {[from |-> r.rid, delta |-> d]}
    /\ last' = Act(do, s, <<>>)

\* A local change is joined as any other one; its clock has ticked before.
Own(r, n, d) == [Join([r EXCEPT !.n = n], d) EXCEPT !.clock = r.clock + 1]

Create(s, key, do) ==
    LET r == site[s]
        dot == <<r.rid, r.n + 1>>
        d == Delta({dot}, {}, {}, {dot})
        born1 == [x \in DOMAIN born \union {dot} |->
                  IF x = dot THEN [key |-> key, ends |-> IF key = "e" THEN Nodes(r) ELSE {}] ELSE born[x]]
    IN /\ born' = born1
       \* nothing can be dead that is new, so Bury may read the old `born`
       /\ Commit(s, [r EXCEPT !.n = @ + 1, !.clock = @ + 1, !.live = @ \union {dot}, !.seen = @ \union {dot}], d, do)
       /\ UNCHANGED removals

AddNode(s) == Nodes(site[s]) = {} /\ Create(s, "a", "add node")
AddEdge(s) == Edges /\ Nodes(site[s]) # {} /\ Shown(site[s]) = {} /\ Create(s, "e", "add edge")

\* A write goes to all incarnations, so that the removal of one loses none; each has a dot of its own.
Write(s) ==
    LET r == site[s]
        owners == Nodes(r)
        nth(o) == r.n + 1 + Cardinality({p \in owners : Before(p, o)})
        writes == {[owner |-> o, stamp |-> r.clock + 1, dot |-> <<r.rid, nth(o)>>] : o \in owners}
        d == Delta({}, writes, {}, Dots(writes))
    IN /\ owners # {}
       /\ Commit(s, Own(r, r.n + Cardinality(owners), d), d, "write")
       /\ UNCHANGED <<born, removals>>

Removal(s, dots, do) ==
    LET r == site[s]
        dot == <<r.rid, r.n + 1>>
        d == Delta({}, {}, dots, {dot})
    IN /\ dots # {}
       /\ removals' = [x \in DOMAIN removals \union {dot} |-> IF x = dot THEN dots ELSE removals[x]]
       /\ Commit(s, [Join([r EXCEPT !.n = @ + 1], d) EXCEPT !.clock = r.clock], d, do)
       /\ UNCHANGED born

RemoveNode(s) == Nodes(site[s]) # {} /\ Removal(s, Nodes(site[s]) \union EdgesOf(site[s]), "remove node")
RemoveEdge(s) == Shown(site[s]) # {} /\ Removal(s, EdgesOf(site[s]), "remove edge")

(* ---- the network: any delta reaches any other replica, at any time, or never ---- *)

\* Who has not joined does not account for a removal, which it cannot judge: it is told of all that it lacks anyway.
Believed(r, d) == IF r.joined THEN d ELSE [d EXCEPT !.dots = d.adds \union Dots(d.writes)]

Deliver(s, m) ==
    LET r == site[s]
        after == Join(r, Believed(r, m.delta))
    IN /\ m.from # r.rid
       /\ after # r \/ Script # Anything
       /\ site' = [site EXCEPT ![s] = after]
       /\ last' = Act("deliver", s, <<m.from, m.delta.dots>>)
       /\ UNCHANGED <<msgs, born, removals, left>>

(* ---- answers in pieces ---- *)

\* The piece of one element that begins at `at`, and where the next one begins; <<0, 0>> if there is none.
PieceOf(r, seen, at) ==
    LET here == {d \in r.live : ~Before(d, at)}
        one == IF here = {} THEN {} ELSE {First(here)}
        rest == here \ one
        end == IF rest = {} THEN <<0, 0>> ELSE First(rest)
        writes == {w \in r.regs : w.owner \in one /\ w.dot \notin seen}
        examined == {d \in r.seen : ~Before(d, at) /\ (rest = {} \/ Before(d, end))}
    IN [end |-> end,
        delta |-> [adds |-> one \ seen, writes |-> writes, removed |-> {},
                   dots |-> (one \ seen) \union Dots(writes), answer |-> TRUE, kept |-> one,
                   examined |-> IF Wrong = "what lives is said of all, not of an interval" THEN r.seen ELSE examined]]

Rest(dots) == [adds |-> {}, writes |-> {}, removed |-> {}, dots |-> dots, answer |-> TRUE, kept |-> {}, examined |-> {}]

\* Joins a piece; after the last one the answerer's context of the first one counts as seen.
Taken(r, p, whole, joined) ==
    LET one == Join(r, p.delta)
        held == r.fetch.held \union {w.dot : w \in {v \in p.delta.writes : v.dot \notin one.seen}}
        early == IF Wrong = "a first piece accounts for the whole" THEN Join(one, Rest(whole)) ELSE one
    IN IF p.end = <<0, 0>>
       THEN [Join(one, Rest(whole \ held)) EXCEPT !.fetch = None, !.joined = @ \/ joined]
       ELSE [early EXCEPT !.fetch.at = p.end, !.fetch.whole = whole, !.fetch.held = held, !.fetch.joined = joined]

Answered(s, r, t) ==
    LET other == site[t]
        first == r.fetch.at = <<0, 1>>
        whole == IF first THEN other.seen ELSE r.fetch.whole
        joined == IF first THEN other.joined ELSE r.fetch.joined
        nothing == first /\ other.seen \subseteq r.fetch.seen
        piece == PieceOf(other, r.fetch.seen, r.fetch.at)
    IN IF nothing THEN [r EXCEPT !.fetch = None, !.joined = @ \/ joined] ELSE Taken(r, piece, whole, joined)

\* A question and the first piece of the answer; `all` if the two know the same and hold something else.
Ask(s, t, all) ==
    LET r == site[s]
        seen == IF all THEN {} ELSE r.seen
    IN /\ s # t /\ left.fetches > 0 /\ r.fetch = None /\ site[t].joined
       /\ all => r.joined /\ r.seen = site[t].seen /\ r.live # site[t].live
       /\ site' = [site EXCEPT ![s] = Answered(s, [r EXCEPT !.fetch = [None EXCEPT !.at = <<0, 1>>, !.from = t,
                                                   !.of = site[t].rid, !.seen = seen]], t)]
       /\ left' = [left EXCEPT !.fetches = @ - 1]
       /\ last' = Act(IF all THEN "ask for all" ELSE "ask", s, <<t>>)
       /\ UNCHANGED <<msgs, born, removals>>

NextPiece(s) ==
    LET r == site[s]
        t == r.fetch.from
    IN /\ r.fetch # None
       /\ site[t].rid = r.fetch.of
       /\ site' = [site EXCEPT ![s] = Answered(s, r, t)]
       /\ last' = Act("next piece", s, <<>>)
       /\ UNCHANGED <<msgs, born, removals, left>>

BreakOff(s) ==
    /\ site[s].fetch # None
    /\ site' = [site EXCEPT ![s].fetch = None]
    /\ last' = Act("break off", s, <<>>)
    /\ UNCHANGED <<msgs, born, removals, left>>

(* ---- death and restart: under another replica id, with the state that was on the disk, or without ---- *)

Restart(s, kept) ==
    LET r == site[s]
        rid == Cardinality(Sites) + Restarts - left.restarts + 1
        same == Wrong = "a replica id is used again"
        new == IF same THEN [Fresh(r.rid) EXCEPT !.joined = FALSE] ELSE Fresh(rid)
    IN /\ left.restarts > 0
       /\ left' = [left EXCEPT !.restarts = @ - 1]
       /\ site' = [site EXCEPT ![s] = IF kept THEN [new EXCEPT !.seen = r.seen, !.live = r.live, !.regs = r.regs,
                       !.clock = Greatest({0} \union {w.stamp : w \in r.regs})] ELSE new]
       /\ last' = Act(IF kept THEN "restart with disk" ELSE "restart", s, <<>>)
       /\ UNCHANGED <<msgs, born, removals>>

Step ==
    \E s \in Sites :
        \/ AddNode(s) \/ AddEdge(s) \/ Write(s) \/ RemoveNode(s) \/ RemoveEdge(s)
        \/ \E m \in msgs : Deliver(s, m)
        \/ \E t \in Sites, all \in BOOLEAN : Ask(s, t, all)
        \/ NextPiece(s) \/ BreakOff(s)
        \/ \E kept \in BOOLEAN : Restart(s, kept)

Next ==
    /\ Step
    /\ count' = count + 1
    /\ Script = Anything \/ (count < Len(Script) /\ last' = Script[count + 1])

\* Broken at the end of the script: so a checker shows what became of it.
Unfinished == Script = Anything \/ count < Len(Script)

Spec == Init /\ [][Next]_vars

(* ---- what must be so ---- *)

RemovedEver == UNION {removals[x] : x \in DOMAIN removals}
WrittenEver == UNION {m.delta.writes : m \in msgs}
\* Whether an incarnation was removed by somebody, or is an edge of which the node was.
Over(d) == d \in RemovedEver \/ (born[d].key = "e" /\ born[d].ends \subseteq RemovedEver)

Of(r) ==
    \* nothing disappears that nobody removed
    /\ \A d \in DOMAIN born : d \in r.seen /\ d \notin r.live => Over(d)
    /\ r.live \subseteq r.seen
    \* what was seen is done: writes are applied, removals too
    /\ \A w \in WrittenEver : w.dot \in r.seen /\ w.owner \in r.live =>
           \E v \in r.regs : v.owner = w.owner /\ (v = w \/ Wins(v, w))
    /\ \A x \in DOMAIN removals : x \in r.seen => removals[x] \intersect r.live = {}
    \* an edge of which the node is gone for good is gone
    /\ Dead(r) = {}
    \* what was made here is known here, and no write waits for what is known
    /\ \A i \in 1..r.n : <<r.rid, i>> \in r.seen
    /\ \A w \in r.waits : w.owner \notin r.seen /\ w.dot \notin r.seen

Right == \A s \in Sites : Of(site[s])

\* Of two that know the same, each difference is a removal that one of them did and cannot account for.
Explained ==
    \A s, t \in Sites : site[s].seen = site[t].seen =>
        \A d \in (site[s].live \ site[t].live) \union (site[t].live \ site[s].live) :
            \/ \E x \in DOMAIN removals : d \in removals[x] /\ x \notin site[s].seen
            \/ born[d].key = "e" /\ \E x \in DOMAIN removals : removals[x] \intersect born[d].ends # {} /\ x \notin site[s].seen

\* What would be simpler, and is not so: a removal may have reached one of them without its dot.
SameHistorySameState ==
    \A s, t \in Sites : site[s].seen = site[t].seen /\ site[s].joined /\ site[t].joined => site[s].live = site[t].live

\* Everybody asks everybody, as often as it takes.
RECURSIVE Pieces(_, _, _, _)
Pieces(r, other, seen, at) ==
    LET p == PieceOf(other, seen, at)
        one == Join(r, p.delta)
    IN IF p.end = <<0, 0>> THEN one ELSE Pieces(one, other, seen, p.end)

Fetched(r, other) ==
    LET differ == r.seen = other.seen /\ r.live # other.live /\ Wrong # "who differs does not ask for all"
        seen == IF differ THEN {} ELSE r.seen
    IN IF other.seen \subseteq seen THEN r ELSE Join(Pieces(r, other, seen, <<0, 1>>), Rest(other.seen))

RECURSIVE Healed(_, _)
Healed(held, pairs) ==
    IF pairs = <<>> THEN held
    ELSE LET s == Head(pairs)[1]
             t == Head(pairs)[2]
             next == CHOOSE r \in {Fetched(held[s], held[t])} : TRUE  \* computed once: TLC evaluates arguments late
         IN Healed(IF next = held[s] THEN held ELSE [held EXCEPT ![s] = next], Tail(pairs))

N == Cardinality(Sites)
Round == [i \in 1..(N * N) |-> <<((i - 1) \div N) + 1, ((i - 1) % N) + 1>>]
Apart == SelectSeq(Round, LAMBDA pair : pair[1] # pair[2])
AtRest == Healed(site, Apart \o Apart \o Apart)

\* After a healing all are equal, hold all that any of them knew, and all above is so of them.
Converges ==
    LET end == AtRest
        one == end[1]
    IN /\ \A s \in Sites : end[s].seen = one.seen /\ end[s].live = one.live /\ end[s].regs = one.regs
       /\ Of(one)
       /\ \A t \in Sites : site[t].seen \subseteq one.seen /\ \A d \in site[t].live : d \in one.live \/ Over(d)

\* What is gone stays gone, and nothing that was seen is forgotten, while a replica lives.
Lasts == [][\A s \in Sites : site'[s].rid = site[s].rid =>
                /\ site[s].seen \subseteq site'[s].seen
                /\ (site'[s].live \intersect site[s].seen) \subseteq site[s].live]_vars

\* Who has joined holds all that the answerer had seen.
JoinedIsComplete == [][\A s \in Sites :
    ~site[s].joined /\ site'[s].joined /\ site'[s].rid = site[s].rid /\ site[s].fetch # None =>
        site[s].fetch.whole \subseteq site'[s].seen \union Dots(site'[s].waits)]_vars

\* No dot is ever issued twice.
FreshDots == \A m, n \in msgs : m # n => m.delta.dots \intersect n.delta.dots = {}
=============================================================================
