"""The arm: its kinematic chain, its cameras and its targets, between a driver and the working memory."""

from agents.arm_controller.agent import ArmController

__all__ = ["ArmController"]
