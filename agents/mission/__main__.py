"""Runs the mission as a process."""

from agents.mission.agent import Mission
from dsr import main

main(Mission)
