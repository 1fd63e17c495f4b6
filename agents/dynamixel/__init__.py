"""An arm of Dynamixel servos, such as the Open Manipulator-P, as a driver."""

from agents.dynamixel.arm import DynamixelArm

__all__ = ["DynamixelArm"]
