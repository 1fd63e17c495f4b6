"""Runs the perspective filter as a process."""

from agents.perspectives.agent import Perspectives
from dsr import main

main(Perspectives)
