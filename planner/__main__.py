"""Runs the planner as a process."""

from dsr.agent import main
from planner.agent import Planner

main(Planner)
