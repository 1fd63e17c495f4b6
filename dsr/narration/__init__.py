"""The memory told in words: sentences made from the graph, each with its basis and evidence.

for statement in account(Moment.of(memory), about=["cube_3"]):
    print(statement.text)

Questions are answered by `dsr.narration.answers`, which needs the extra `cli` for its grammar.
"""

from dsr.narration.account import LATELY, account, chapters, check_names
from dsr.narration.chances import chances, chances_of_thing
from dsr.narration.happenings import entry_statements, happening_statements
from dsr.narration.persons import person_account, world_of
from dsr.narration.places import place_of_thing, place_statements
from dsr.narration.statements import Basis, Moment, StatedClaim, Statement, Subject

__all__ = [
    "LATELY",
    "Basis",
    "Moment",
    "StatedClaim",
    "Statement",
    "Subject",
    "account",
    "chances",
    "chances_of_thing",
    "chapters",
    "check_names",
    "entry_statements",
    "happening_statements",
    "person_account",
    "place_of_thing",
    "place_statements",
    "world_of",
]
