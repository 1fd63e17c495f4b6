"""Runs the hand tracker as a process."""

from agents.hand_tracker.agent import HandTracker
from dsr import main

main(HandTracker)
