"""Bags of ROS: recordings exported as bags, and bags of others as recordings and as cameras."""

from agents.ros_bridge.bags.camera import BagCamera

__all__ = ["BagCamera"]
