"""Runs the simulation handler as a process."""

from dsr import main
from simulation_handler.agent import SimulationHandler

main(SimulationHandler)
