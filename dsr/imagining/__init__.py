"""Imagined scenes, kept as worlds: things put somewhere by a relation, and plans carried out step by step.

idea = memory.fork("idea")
think(placed(memory, idea, "ball", "behind", "human_1"), WhatIf(memory.transport, memory.keys, memory.clock))
"""

from dsr.imagining.placing import PLACEABLE, placed
from dsr.imagining.plans import Outcome, Step, best, carried_out, parse_step
from dsr.imagining.scenes import differences, keep
from dsr.imagining.thinking import Thinking, Thought, think

__all__ = [
    "PLACEABLE",
    "Outcome",
    "Step",
    "Thinking",
    "Thought",
    "best",
    "carried_out",
    "differences",
    "keep",
    "parse_step",
    "placed",
    "think",
]
