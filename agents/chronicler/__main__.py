"""Runs the chronicler as a process."""

from agents.chronicler.agent import Chronicler
from dsr import main

main(Chronicler)
