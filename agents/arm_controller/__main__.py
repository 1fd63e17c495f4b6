"""Runs the arm controller as a process."""

from agents.arm_controller.agent import ArmController
from dsr.agent import main

main(ArmController)
