"""Runs the imagination as a process."""

from agents.imagination.agent import Imagination
from dsr import main

main(Imagination)
