"""The grammar of questions in plain English: its words, its rules, and an example of each kind."""

from __future__ import annotations

WORDS = {
    "BE": "is are was were be being been", "DO": "do does did", "CAN": "can could might", "WILL": "will would",
    "HAS": "has have had", "WHERE": "where whereabouts", "WHAT": "what which", "WHO": "who",
    "WHEN": "when", "WHY": "why", "HOW": "how", "LONG": "long", "MANY": "many", "IF": "if",
    "THERE": "there", "AT": "at", "SINCE": "since",
    "LAST": "last", "LATELY": "lately recently", "NOW": "now currently",
    "ANY": "anything something anyone anybody someone somebody nothing nobody another", "SURE": "sure certain",
    "CLOSEST": "closest nearest", "CHANGE": "change changes changed", "ABOUT": "about", "GO": "go goes went",
    "COLOUR": "colour color", "LARGE": "big large tall wide high size", "HEAVY": "heavy weigh weighs",
    "DET": "the a an my your this that", "ON": "on onto upon", "IN": "in into inside within",
    "UNDER": "under beneath underneath", "BY": "by", "TO": "to", "OF": "of", "FOR": "for", "NOT": "not",
    "ABOVE": "above over", "BELOW": "below", "NEAR": "near beside", "NEXT": "next", "SEE": "see sees seeing",
    "SEEN": "seen", "VISIBLE": "visible", "UNSEEN": "unseen hidden invisible", "HIDE": "hide hides hiding",
    "HOLD": "hold holds holding carrying grasping gripping", "HELD": "held", "THINK": "think thinks believe believes",
    "BELIEVED": "believed thought", "KNOW": "know knows", "LOOK": "look search", "WRONG": "wrong mistaken",
    "SURPRISING": "surprising surprised surprise surprises odd strange unusual weird unexpected",
    "GONE": "gone missing", "WANT": "want wants",
    "WAIT": "wait waits waiting", "DOING": "doing", "GOAL": "goal mission task plan",
    "HAPPEN": "happen happens happened",
    "MOVE": "move moves moved moving push pushed slide slid shift shifted bring brought carry carried",
    "BUMP": "bump bumped knock knocked kick kicked hit",
    "FALL": "fall falls fell fallen", "STAY": "stay stays stayed remain remained stand stands",
    "REST": "standing rest rests resting lie lies lying sit sits sitting",
    "APPEAR": "appear appeared", "VANISH": "disappear disappeared vanish vanished",
    "PICK": "pick picked take took taken lift lifted grab grabbed", "PUT": "put place placed lay laid",
    "DROP": "drop dropped release released", "UP": "up", "DOWN": "down", "AWAY": "away", "REMOVE": "remove removed",
    "STOP": "stop stopped", "COME": "come came get got", "SECONDS": "s sec secs seconds",
    "MINUTES": "min mins minutes", "AND": "and", "SOME_OF": "any either some", "ALL_OF": "all both each every",
    "BEHIND": "behind", "FRONT": "front", "LEFT": "left", "RIGHT": "right", "FROM": "from", "AS": "as",
    "EMPTY": "empty", "WITH": "with", "END": "end ended", "FIND": "find", "MAKE": "makes make",
    "DONE": "done finished completed", "ELSE": "else", "AGO": "ago", "NEW": "new", "LIST": "list",
    "CONTAIN": "contain contains",
    "WATCH": "looking watching", "SAME": "same",
    "TOP": "top topmost upper uppermost highest", "BOTTOM": "bottom lower lowest",
    "LARGEST": "biggest largest", "SMALLEST": "smallest", "HEAVIEST": "heaviest", "LIGHTEST": "lightest",
    "USED": "used", "FAR": "far",
}  # fmt: skip
"""The words of each terminal. None of them can be the name of a thing."""
GRAMMAR = r"""
start: question view? NOW? when?

question: where | where_else | where_in | where_by | last_seen | last_seen_by | contents | contents_by | is_so
    | is_so_by | knows | is_wrong | is_there | sees | is_visible | who_sees | what_sees | hides | holder | held
    | is_holding
    | when_was | since_when | how_long | how_long_so | why_so | why_state | why_waits | why_moved | happened | who_did
    | what_if | would | wants | doing | count | which | any_so | was_done | what_unseen | surprises | sure | closest
    | property | was_so | why_not_so | unmoved | how_long_there | any_sees | is_empty | any_state | which_state
    | did_by | any_did | has_seen | any_held | any_seen | extreme | which_on | any_on
    | when_did | which_did | last_done | deeds_of | distance

where: WHERE BE thing (GONE | COME TO | GO)? | WHERE thing BE | WHERE (DO | HAS) thing (GO | COME TO | GONE | END UP)
    | WHERE CAN thing FIND thing | WHERE thing GO
where_else: WHERE ELSE? (CAN | WILL) thing BE | WHERE ELSE BE thing | CAN thing BE WORD? ELSE
where_in: WHAT thing (CONTAIN | HOLD) thing | WHAT CONTAIN thing | WHAT thing? BE thing (REST | UNSEEN | HELD)? relation
    | relation WHAT thing? BE thing (REST | UNSEEN | HELD)? | relation WHAT thing? (DO | HAS) thing (GO | END UP)
where_by: WHERE DO thing THINK (DET? thing) BE | WHERE WILL thing LOOK FOR thing
    | WHERE BE thing BE? BELIEVED BY thing | WHERE thing WILL LOOK FOR thing
last_seen: WHEN BE thing LAST? SEEN | HOW LONG AGO BE thing LAST? SEEN | WHEN BE thing SEEN LAST
last_seen_by: WHEN DO thing LAST SEE thing | HOW LONG AGO DO thing LAST? SEE thing | WHEN BE thing LAST SEEN BY thing
contents: WHAT thing? DO thing CONTAIN | WHAT BE thing relation thing
    | WHAT BE (REST | THERE)? relation thing | WHAT REST relation thing | WHAT thing BE REST? relation thing
any_so: BE THERE (ANY | thing) relation thing | BE ANY REST? relation thing
contents_by: WHAT DO thing THINK BE relation thing
is_so: BE thing REST? relation thing | DO thing CONTAIN thing
was_so: HAS thing BE REST? relation thing
is_so_by: DO thing (THINK | KNOW) that? thing BE relation thing
that: DET
knows: DO thing KNOW WHERE thing BE | DO thing KNOW that? thing (BE | HAS) BE? (did | state)
    | DO thing KNOW (ABOUT | OF) thing
is_wrong: BE thing WRONG OF? ABOUT? thing
is_there: BE THERE thing | BE thing THERE | BE thing state | HAS thing GONE
sees: (CAN | DO) thing SEE thing
any_sees: (CAN | DO) ANY SEE thing | BE ANY WATCH thing
is_visible: BE thing VISIBLE (TO thing)?
who_sees: WHO CAN? SEE thing | WHO BE SEE thing
what_sees: (WHAT thing? | HOW MANY thing) (CAN | DO) thing SEE | WHAT BE thing (SEE | WATCH AT?)
any_seen: (CAN | DO) thing SEE ANY
has_seen: HAS thing SEEN thing
what_unseen: WHAT thing? (CAN | DO) (NOT thing | thing NOT) SEE
hides: WHAT (BE)? HIDE thing
holder: WHAT HOLD thing | WHO BE? (HOLD | HELD) thing | WHO HAS thing | WHERE BE thing HELD
held: WHAT BE thing HOLD | WHAT DO thing (HOLD | HAS)
is_holding: BE thing HOLD thing | DO thing (HOLD | HAS) thing
any_held: BE ANY HOLD thing | (DO | HAS) ANY HOLD thing
is_empty: BE thing EMPTY
when_was: (WHEN | HOW LONG AGO) (BE | DO) thing LAST? did | WHEN BE thing did LAST
when_did: WHEN (DO | HAS) (ANY | thing) did_what thing ending?
since_when: SINCE WHEN BE thing relation thing | WHEN DO thing COME relation thing
how_long: HOW LONG HAS thing BE UNSEEN | HOW LONG BE thing UNSEEN
how_long_so: HOW LONG HAS thing BE REST? relation thing | HOW LONG BE thing REST? relation thing
how_long_there: HOW LONG HAS thing BE (REST | STOP | HELD)? (THERE | WHERE thing BE)? | HOW LONG BE thing (THERE | HELD)
why_so: WHY BE thing (BE? BELIEVED TO? BE?)? relation thing | WHY DO thing THINK that? thing BE relation thing
    | HOW DO thing KNOW that? thing BE relation thing
why_not_so: WHY BE (thing NOT | NOT thing) REST? relation thing | WHY thing BE NOT REST? relation thing
unmoved: (DO | HAS) thing (STAY | BE) WHERE thing BE
    | BE thing WHERE thing (BE | USED TO BE) | BE thing WHERE thing LEFT thing | BE thing (IN | AT) DET? SAME PUT
why_state: WHY BE thing state | WHY BE NOT thing (VISIBLE | SEEN)
    | WHY (CAN | DO) (thing NOT | NOT thing) SEE thing
why_waits: WHY DO thing (WAIT | STOP | NOT MOVE) | WHY BE thing (WAIT | STOP | REST | NOT did)
    | WHY (BE | DO) (NOT thing | thing NOT) (DOING | DO) ANY | WHY BE NOT thing MOVE
why_moved: WHY DO thing (MOVE | FALL) | WHY BE thing did
happened: ANY NEW | WHAT BE NEW (WITH thing)?
    | WHAT HAS? (HAPPEN | CHANGE) ((TO | WITH | ABOUT) thing)? | (HAS | DO) ANY (HAPPEN | CHANGE) (TO thing)?
surprises: WHAT (BE | HAS)? SURPRISING thing? | (BE | HAS | DO) (ANY | thing) SURPRISING thing?
    | BE THERE (ANY | DET)? SURPRISING
who_did: (WHO | WHAT) (HAS | BE)? did_what thing ending? | WHO (HAS | BE)? placed thing relation thing
    | (DO | HAS) ANY did_what thing ending? -> did_any | (DO | HAS) ANY placed thing relation thing -> did_any
did_by: (DO | HAS) thing did_what thing ending? | (DO | HAS) thing placed thing relation thing
any_did: (DO | HAS | BE) ANY BE? did
which_did: WHAT thing? (HAS | BE)? BE? did | WHAT thing? (DO | HAS) (ANY | thing) did_what ending?
last_done: WHAT BE DET? LAST thing that? (ANY | thing) (HAS | BE)? did_what ending?
    | WHAT BE DET? LAST thing (TO BE)? did | WHAT thing? (HAS | BE)? BE? did LAST
    | WHAT thing? (DO | HAS) (ANY | thing) did_what ending? LAST
deeds_of: WHAT (DO | HAS) (ANY | thing) (DO | DONE) ((WITH | TO) thing)? | WHAT (BE | HAS) BE? DONE (WITH | TO) thing
extreme.2: WHAT thing? BE DET? (TOP | BOTTOM) thing? ((OF | IN | ON) thing)? | WHAT thing? BE ON DET? (TOP | BOTTOM)
    | WHAT thing? BE DET? (LARGEST | SMALLEST | HEAVIEST | LIGHTEST) thing? ((OF | IN | ON) thing)?
which_on: WHAT thing? BE REST? relation another
any_on: BE ANY REST? relation another
another: ANY WORD?
ending: UP | DOWN | AWAY | THERE
placed: MOVE | PUT | DROP
any_state: BE ANY state
which_state: WHAT thing? BE state
was_done: (DO | HAS) thing BE? did | BE thing did
what_if: WHAT WILL? HAPPEN? IF change | IF change WHAT WILL (HAPPEN | FALL | MOVE)
would: WILL (thing | ANY) falls IF change | IF change WILL (thing | ANY) falls
wants: WHAT DO thing WANT | WHAT BE DET? GOAL (OF thing)? | BE DET? GOAL (DONE | END)
    | WHAT DO thing WAIT FOR | WHAT BE thing WAIT FOR
doing: WHAT BE thing DOING
count: HOW MANY thing BE THERE? (REST? relation thing)?
which: WHAT thing BE THERE | WHAT BE THERE | LIST thing | WHAT thing DO thing KNOW
sure: HOW SURE BE thing ABOUT? that? WHERE? thing BE? (relation thing | THERE)?
    | BE thing SURE ABOUT? that? WHERE? thing BE? (relation thing | THERE)?
closest: WHAT thing? BE DET? CLOSEST thing? TO thing
distance: HOW FAR AWAY? BE thing AWAY? FROM thing
property: WHAT BE DET? (COLOUR | LARGE) OF thing | WHAT COLOUR BE thing | HOW (LARGE | HEAVY) BE thing
    | HOW (LARGE | HEAVY) DO thing HEAVY | WHAT DO thing HEAVY

change: thing BE (REMOVE | PICK AWAY | GONE) -> remove
    | thing (REMOVE | PICK AWAY?) thing AWAY? -> remove_by
    | thing BE HELD -> hold
    | thing BE (PUT | MOVE) ON thing -> put
    | thing PUT thing ON thing -> put
falls: (FALL | MOVE | STAY) ABOVE? DOWN?
did: MOVE | BUMP IN? | PICK UP? | PICK AWAY | PUT DOWN? | DROP | FALL | APPEAR | VANISH | REMOVE
did_what: MOVE | BUMP IN? | PICK (UP | AWAY)? | PUT DOWN? | DROP | REMOVE
view: (AS? SEEN)? FROM thing
state: SURPRISING | GONE | UNSEEN | THERE | VISIBLE | NOT VISIBLE | NOT SEEN
relation: ON | IN | UNDER | ABOVE | BELOW | NEAR | NEXT TO | BEHIND | IN FRONT OF | (TO | ON)? DET? (LEFT | RIGHT) OF
when: SPAN -> span | AT NUMBER unit? -> at | SINCE AT? NUMBER unit? -> since | LATELY -> lately
unit: SECONDS -> seconds | MINUTES -> minutes
thing: single (AND single)*
single: ((SOME_OF | ALL_OF) OF?)? DET? word+
?word: WORD | LARGE | HEAVY | COLOUR | CHANGE | GO | LEFT | RIGHT | FRONT | END | SAME | TOP | BOTTOM | NEW | LIST
    | DONE | LARGEST | SMALLEST

NUMBER: /\d+(\.\d+)?/
WORD: /[^\W\d][\w.\-]*/
SPAN: "\x02"
%ignore /[\s?!.,"]+/
"""
TIMED = frozenset({
    "where", "where_in", "contents", "any_so", "is_so", "holder", "when_was", "happened", "surprises", "who_did",
    "did_any", "was_done", "was_so", "did_by", "when_did", "which_did", "last_done", "deeds_of", "unmoved",
    "any_did", "has_seen",
})  # fmt: skip
"""Kinds of questions that can be about the past. All others are answered as of now."""
EXAMPLES = {
    "where": "where is the THING?", "where_then": "where was the THING last Tuesday, and who moved it?",
    "where_in": "what is the THING in?",
    "where_by": "where does PERSON think the THING is?", "last_seen": "when was the THING last seen?",
    "last_seen_by": "when did PERSON last see the THING?", "contents": "what is on the table?",
    "contents_by": "what does PERSON think is in the THING?", "is_so": "is the THING on the table?",
    "is_so_by": "does PERSON believe that the THING is on the table?", "knows": "does PERSON know where the THING is?",
    "sees": "can PERSON see the THING?", "is_visible": "is the THING visible?", "who_sees": "who sees the THING?",
    "what_sees": "what does PERSON see?", "hides": "what hides the THING?", "holder": "who holds the THING?",
    "held": "what does the gripper hold?", "when_was": "when was the THING picked up?",
    "since_when": "since when is the THING on the table?", "how_long": "how long has the THING been unseen?",
    "why_so": "why is the THING on the table?", "why_state": "why is the THING surprising?",
    "why_waits": "why does the robot wait?", "why_moved": "why did the THING move?",
    "happened": "what happened to the THING this morning?", "who_did": "who picked the THING up?",
    "what_if": "what if the THING were removed?", "would": "would the THING fall if the OTHER were removed?",
    "any_so": "is there anything on the THING?", "was_done": "did the THING fall?",
    "did_any": "did anybody move the THING yesterday?", "what_unseen": "which things can PERSON not see?",
    "surprises": "what was surprising yesterday?", "sure": "how sure are you about where the THING is?",
    "closest": "what is the closest thing to the THING?", "property": "how big is the THING?",
    "was_so": "has the THING ever been on the OTHER?", "behind": "what is behind the THING, seen from PERSON?",
    "unmoved": "is the THING where it was 10 s ago?", "how_long_there": "how long has the THING been there?",
    "any_sees": "can anybody see the THING?", "is_empty": "is the gripper empty?", "which_state": "what is hidden?",
    "did_by": "did the gripper put the THING down?", "which_did": "what was moved this morning?",
    "last_done": "what was picked up last?", "deeds_of": "what did anybody do with the THING?",
    "why_not_so": "why is the THING not on the table?", "distance": "how far is the THING from the OTHER?",
    "groups": "are the THING and the OTHER on the table?", "any_of": "is any of the cubes hidden?",
    "any_did": "did anything move?", "has_seen": "have you seen the THING?",
    "any_held": "is anybody holding the THING?",
    "any_seen": "can you see anything?", "extreme": "what is on top?", "which_on": "what is on top of something?",
    "any_on": "is anything on another thing?",
    "where_else": "where else could the THING be?",
    "wants": "what does the robot want?", "count": "how many cubes are there?", "which": "what is there?",
}  # fmt: skip
"""A question of each kind, to show when another is not understood."""
