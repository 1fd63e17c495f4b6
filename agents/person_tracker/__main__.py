"""Runs the person tracker as a process."""

from agents.person_tracker.agent import PersonTracker
from dsr import main

main(PersonTracker)
