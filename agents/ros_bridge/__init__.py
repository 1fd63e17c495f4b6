"""Connects the memory with robots that speak ROS 2, without an installation of ROS."""

from agents.ros_bridge.agent import RosBridge
from agents.ros_bridge.bags.camera import BagCamera
from agents.ros_bridge.bridge.config import RosBridgeConfig
from agents.ros_bridge.services.arm import RosArm
from agents.ros_bridge.services.camera import RosCamera
from agents.ros_bridge.services.tags import RosTags

__all__ = ["BagCamera", "RosArm", "RosBridge", "RosBridgeConfig", "RosCamera", "RosTags"]
