"""Runs the mission as a process."""

from agents.mission.agent import Mission
from dsr.agent import main

main(Mission)
