"""Runs the perspective filter as a process."""

from agents.perspectives.agent import Perspectives
from dsr.agent import main

main(Perspectives)
