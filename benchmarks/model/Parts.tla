------------------------------- MODULE Parts -------------------------------
(* Parts of a graph that share no dots, edges between them, and replicas that hold one, both or none, and change their *)
(* minds: every order of messages, each lost, late or repeated.                                                        *)
(*                                                                                                                     *)
(* The rules are those of dsr.parts.graph. Within a part they are those of Replicas.tla; of these, answers in pieces,  *)
(* attributes and restarts are left out. Node "x" is in part 1, node "y" in part 2, and the edge from "x" to "y" in    *)
(* part 1. `python -m benchmarks.model --parts` checks it.                                                             *)
EXTENDS Integers, FiniteSets, Sequences

CONSTANTS
    Sites,      \* places, 1..n; the first one holds both parts, the second one part 2, all others part 1
    Changes,    \* additions and removals in a history
    Fetches,    \* answers
    Moves,      \* times when a replica begins to hold a part, or holds it no more
    Wrong       \* name of the rule that is left out; "" for none

VARIABLES
    site,       \* what each place holds of each part
    msgs,       \* every delta that was ever sent, with the part that it is of
    born,       \* what was created under each dot: its key, and the incarnations of its ends
    removals,   \* what users removed, by the dots of the removals
    buried,     \* what was buried in the part of an edge for an end in the other one, by the dots of the removals
    left,       \* changes, answers and moves that are left
    ids,        \* replica ids so far
    last        \* the action that led here

vars == <<site, msgs, born, removals, buried, left, ids, last>>
view == <<site, msgs, born, removals, buried, left>>

Parts == {1, 2}
HomeOf(key) == IF key = "y" THEN 2 ELSE 1
Nobody == [held |-> FALSE, rid |-> 0, n |-> 0, seen |-> {}, live |-> {}]
X == <<1, 1>>   \* what is there from the beginning
Y == <<2, 1>>

Begun(s, p) ==
    IF s = 1 \/ (s = 2 /\ p = 2) \/ (s > 2 /\ p = 1)
    THEN [held |-> TRUE, rid |-> IF s = 1 THEN p ELSE s + 1, n |-> IF s = 1 THEN 1 ELSE 0,
          seen |-> {IF p = 1 THEN X ELSE Y}, live |-> {IF p = 1 THEN X ELSE Y}]
    ELSE Nobody

Init ==
    /\ site = [s \in Sites |-> [p \in Parts |-> Begun(s, p)]]
    /\ msgs = {}
    /\ born = [d \in {X, Y} |-> [key |-> IF d = X THEN "x" ELSE "y", from |-> {}, to |-> {}]]
    /\ removals = <<>>
    /\ buried = <<>>
    /\ left = [changes |-> Changes, fetches |-> Fetches, moves |-> Moves]
    /\ ids = Cardinality(Sites) + 1
    /\ last = [do |-> "start", site |-> 0, with |-> 0]

(* ---- what is seen ---- *)

Live(r, key) == {d \in r[HomeOf(key)].live : born[d].key = key}
Edges(r) == Live(r, "e")
Shown(r) == {d \in Edges(r) : born[d].from \intersect r[1].live # {} /\ born[d].to \intersect r[2].live # {}}
Gone(ends, part) == ends \subseteq part.seen /\ ends \intersect part.live = {}

\* Edges that nobody can ever show again, as far as the part of the edge tells: all who hold it know that.
DeadAlone(part) == {d \in part.live : born[d].key = "e" /\ Gone(born[d].from, part)}
\* And those that died of an end in the other part: only who holds both knows that.
DeadBeyond(r) ==
    {d \in Edges(r) : \/ r[2].held /\ Gone(born[d].to, r[2])
                      \/ Wrong = "who does not hold the other part buries" /\ born[d].to \intersect r[2].live = {}}

Settled(part) == [part EXCEPT !.live = @ \ DeadAlone(part)]

\* Join additions, removals, and the dots that they account for.
Join(part, adds, removed, dots) ==
    LET live1 == part.live \ removed
        new == {d \in adds : d \notin part.seen /\ d \notin removed}
    IN Settled([part EXCEPT !.live = live1 \union new, !.seen = @ \union removed \union new \union dots])

Delta(p, rid, adds, removed, dots) == [part |-> p, from |-> rid, adds |-> adds, removed |-> removed, dots |-> dots]

(* ---- what users do ---- *)

Act(do, s, with) == last' = [do |-> do, site |-> s, with |-> with]
Change == left.changes > 0 /\ left' = [left EXCEPT !.changes = @ - 1]

Add(s, key) ==
    LET r == site[s]
        p == HomeOf(key)
        dot == <<r[p].rid, r[p].n + 1>>
        \* nothing can be dead that is new, so the old `born` tells all
        after == [r[p] EXCEPT !.n = @ + 1, !.live = @ \union {dot}, !.seen = @ \union {dot}]
    IN /\ Change
       /\ r[p].held
       /\ IF key = "e" THEN Live(r, "x") # {} /\ Live(r, "y") # {} /\ r[2].held /\ Shown(r) = {} ELSE Live(r, key) = {}
       /\ born' = [d \in DOMAIN born \union {dot} |->
              IF d # dot THEN born[d]
              ELSE [key |-> key, from |-> IF key = "e" THEN Live(r, "x") ELSE {},
                    to |-> IF key = "e" THEN Live(r, "y") ELSE {}]]
       /\ site' = [site EXCEPT ![s][p] = after]
       /\ msgs' = msgs \union {Delta(p, r[p].rid, {dot}, {}, {dot})}
       /\ Act("add", s, key)
       /\ UNCHANGED <<removals, buried, ids>>

\* Who removes a node removes the edges that it holds, with one removal in each part.
Remove(s, key) ==
    LET r == site[s]
        p == HomeOf(key)
        gone == [q \in Parts |-> (IF p = q THEN Live(r, key) ELSE {})
                                 \union (IF q = 1 /\ key # "e" THEN Edges(r) ELSE {})]
        dot(q) == <<r[q].rid, r[q].n + 1>>
        in == {q \in Parts : gone[q] # {}}
    IN /\ Change
       /\ r[p].held /\ Live(r, key) # {}
       /\ removals' = [d \in DOMAIN removals \union {dot(q) : q \in in} |->
              IF d \in DOMAIN removals THEN removals[d] ELSE gone[CHOOSE q \in in : dot(q) = d]]
       /\ site' = [site EXCEPT ![s] = [q \in Parts |->
              IF q \in in THEN Join([r[q] EXCEPT !.n = @ + 1], {}, gone[q], {dot(q)}) ELSE r[q]]]
       /\ msgs' = msgs \union {Delta(q, r[q].rid, {}, gone[q], {dot(q)}) : q \in in}
       /\ Act("remove", s, key)
       /\ UNCHANGED <<born, buried, ids>>

(* ---- burying across parts: a removal with a dot, so that who holds only the part of the edge hears of it ---- *)

BuriedBy(r) ==
    LET dot == <<r[1].rid, r[1].n + 1>>
    IN [r EXCEPT ![1] = Join([r[1] EXCEPT !.n = @ + 1], {}, DeadBeyond(r), {dot})]

Bury(s) ==
    LET r == site[s]
        dead == DeadBeyond(r)
        dot == <<r[1].rid, r[1].n + 1>>
    IN /\ r[1].held /\ dead # {}
       /\ site' = [site EXCEPT ![s] = BuriedBy(r)]
       /\ msgs' = msgs \union {Delta(1, r[1].rid, {}, dead, {dot})}
       /\ buried' = [d \in DOMAIN buried \union {dot} |-> IF d = dot THEN dead ELSE buried[d]]
       /\ Act("bury", s, 0)
       /\ UNCHANGED <<born, removals, left, ids>>

(* ---- asking for a part, and holding it no more ---- *)

Hold(s, p) ==
    LET again == site[s][p].rid # 0 /\ Wrong = "a replica id is used again"
    IN /\ left.moves > 0 /\ ~site[s][p].held
       /\ left' = [left EXCEPT !.moves = @ - 1]
       /\ ids' = ids + 1
       /\ site' = [site EXCEPT ![s][p] = [Nobody EXCEPT !.held = TRUE, !.rid = IF again THEN site[s][p].rid ELSE ids + 1]]
       /\ Act("hold", s, p)
       /\ UNCHANGED <<msgs, born, removals, buried>>

\* Nothing is left that could answer; but for a question that is under way, see Late.
Leave(s, p) ==
    /\ left.moves > 0 /\ site[s][p].held
    /\ left' = [left EXCEPT !.moves = @ - 1]
    /\ site' = [site EXCEPT ![s][p] = [@ EXCEPT !.held = FALSE, !.live = {}]]
    /\ Act("leave", s, p)
    /\ UNCHANGED <<msgs, born, removals, buried, ids>>

(* ---- the network ---- *)

Deliver(s, m) ==
    LET part == site[s][m.part]
        after == Join(part, m.adds, m.removed, m.dots)
    IN /\ part.held /\ m.from # part.rid /\ after # part
       /\ site' = [site EXCEPT ![s][m.part] = after]
       /\ Act("deliver", s, m.from)
       /\ UNCHANGED <<msgs, born, removals, buried, left, ids>>

Answered(mine, theirs) ==
    Join(mine, theirs.live \ mine.seen, {d \in mine.live : d \in theirs.seen /\ d \notin theirs.live}, theirs.seen)

Answers(part) == part.held \/ (Wrong = "who left answers as if it were empty" /\ part.rid # 0)

Ask(s, t, p) ==
    LET after == Answered(site[s][p], site[t][p])
    IN /\ s # t /\ left.fetches > 0 /\ site[s][p].held /\ Answers(site[t][p]) /\ after # site[s][p]
       /\ left' = [left EXCEPT !.fetches = @ - 1]
       /\ site' = [site EXCEPT ![s][p] = after]
       /\ Act("ask", s, t)
       /\ UNCHANGED <<msgs, born, removals, buried, ids>>

Next ==
    \E s \in Sites :
        \/ \E key \in {"x", "y", "e"} : Add(s, key) \/ Remove(s, key)
        \/ Bury(s)
        \/ \E p \in Parts : Hold(s, p) \/ Leave(s, p)
        \/ \E m \in msgs : Deliver(s, m)
        \/ \E t \in Sites, p \in Parts : Ask(s, t, p)

Spec == Init /\ [][Next]_vars

(* ---- what must be so ---- *)

RemovedEver == UNION {removals[x] : x \in DOMAIN removals}
\* Whether users have removed it, or all incarnations of the node at one of its ends.
Over(d) ==
    \/ d \in RemovedEver
    \/ born[d].key = "e" /\ (born[d].from \subseteq RemovedEver \/ born[d].to \subseteq RemovedEver)

Right == \A s \in Sites, p \in Parts : LET part == site[s][p] IN part.held =>
    \* nothing disappears that nobody removed, and what was seen to be removed is gone
    /\ \A d \in DOMAIN born : d \in part.seen /\ d \notin part.live => Over(d)
    /\ \A x \in DOMAIN removals : x \in part.seen => removals[x] \intersect part.live = {}
    /\ \A x \in DOMAIN buried : x \in part.seen => buried[x] \intersect part.live = {}
    /\ part.live \subseteq part.seen
    /\ DeadAlone(part) = {}

\* Nobody is buried alive.
Dead == \A x \in DOMAIN buried : \A d \in buried[x] : Over(d)

\* An edge that is shown has both its ends, and both parts are held.
NoneDangles == \A s \in Sites : Shown(site[s]) # {} => site[s][1].held /\ site[s][2].held

FreshDots == \A m, n \in msgs : m # n => m.dots \intersect n.dots = {}

\* All who hold a part ask all others who do. What is bound in a set is computed once: TLC evaluates arguments late.
Fetched(held, s, t) ==
    [held EXCEPT ![s] = [p \in Parts |->
        IF held[s][p].held /\ held[t][p].held THEN Answered(held[s][p], held[t][p]) ELSE held[s][p]]]

RECURSIVE Healed(_, _)
Healed(held, pairs) ==
    IF pairs = <<>> THEN held
    ELSE CHOOSE end \in {Healed(h, Tail(pairs)) : h \in {Fetched(held, Head(pairs)[1], Head(pairs)[2])}} : TRUE

N == Cardinality(Sites)
Round == [i \in 1..(N * N) |-> <<((i - 1) \div N) + 1, ((i - 1) % N) + 1>>]
Apart == SelectSeq(Round, LAMBDA pair : pair[1] # pair[2])
Together(held) == Healed(held, Apart \o Apart)
AllBury(held) == [s \in Sites |-> IF held[s][1].held /\ DeadBeyond(held[s]) # {} THEN BuriedBy(held[s]) ELSE held[s]]
AtRest == CHOOSE end \in UNION {{Together(b) : b \in {AllBury(h)}} : h \in {Together(site)}} : TRUE

\* What each holds is what the whole holds there: all that any holder knew, equal at all, and nothing that is over for
\* those who hold both parts.
Converges == \A end \in {AtRest} :
    \A p \in Parts, s \in Sites : end[s][p].held =>
        /\ \A t \in Sites : end[t][p].held => end[s][p].seen = end[t][p].seen /\ end[s][p].live = end[t][p].live
        /\ \A t \in Sites : site[t][p].held =>
            site[t][p].seen \subseteq end[s][p].seen /\ \A d \in site[t][p].live : d \in end[s][p].live \/ Over(d)
        /\ \A t \in Sites : p = 1 /\ end[t][1].held /\ end[t][2].held =>
            \A d \in end[s][1].live : born[d].key = "e" => ~Gone(born[d].to, end[t][2])
=============================================================================
