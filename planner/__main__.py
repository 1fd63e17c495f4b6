"""Runs the planner as a process."""

from dsr import main
from planner.agent import Planner

main(Planner)
