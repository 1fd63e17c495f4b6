"""Runs the calibrator as a process."""

from agents.calibrator.agent import Calibrator
from dsr import main

main(Calibrator)
