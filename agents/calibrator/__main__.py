"""Runs the calibrator as a process."""

from agents.calibrator.agent import Calibrator
from dsr.agent import main

main(Calibrator)
