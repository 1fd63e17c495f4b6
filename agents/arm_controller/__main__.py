"""Runs the arm controller as a process."""

from agents.arm_controller.agent import ArmController
from dsr import main

main(ArmController)
