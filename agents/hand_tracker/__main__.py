"""Runs the hand tracker as a process."""

from agents.hand_tracker.agent import HandTracker
from dsr.agent import main

main(HandTracker)
