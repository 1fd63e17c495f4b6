"""What `dsr drivers` says of the drivers that come with `dsr`: data alone, so that a list needs no library."""

from __future__ import annotations

import importlib.util
import os
import sys

from agents.cameras.realsense import what_is_missing
from agents.cameras.webcam import NO_PERMISSION, devices
from agents.drivers import ArmEntry, CameraEntry
from dsr.config.extras import missing_extra


def absent(*libraries: str) -> list[str]:
    """What is missing of these modules, with the remedy."""
    missing = [name for name in libraries if importlib.util.find_spec(name) is None]
    return [missing_extra(ModuleNotFoundError(name=name)) or f"{name!r} is not installed" for name in missing]


def _no_webcam() -> list[str]:
    missing = absent("cv2")
    if sys.platform == "linux":
        there = devices()
        if not there:
            missing.append("no camera is connected: there is no /dev/video*")
        elif not any(os.access(path, os.R_OK | os.W_OK) for path in there):
            missing.append(NO_PERMISSION.format(there[0]))
    return missing


WEBCAM = CameraEntry(
    driver="agents.cameras:Webcam",
    what="a webcam, by OpenCV",
    gives="colour",
    needs="a camera that the system knows",
    missing=_no_webcam,
    extra="sim",
)
VIDEO = CameraEntry(
    driver="agents.cameras:VideoFile",
    what="a video file, by OpenCV",
    gives="colour",
    needs="the file",
    missing=lambda: absent("cv2"),
    extra="sim",
    example=("file=film.mp4",),
)
REALSENSE = CameraEntry(
    driver="agents.cameras:RealSense",
    what="a RealSense, or a recording of one",
    gives="colour and depth",
    needs="the camera, and Debian's libusb-1.0-0",
    missing=what_is_missing,
    extra="realsense",
)
ROS = CameraEntry(
    driver="agents.ros_bridge:RosCamera",
    what="topics of a robot that speaks ROS 2",
    gives="colour and depth",
    needs="nodes that publish images, and with rmw_zenoh their router",
    missing=lambda: absent("rosbags", "xxhash"),
    extra="ros",
    example=("color=/camera/color/image_raw",),
)
BAG = CameraEntry(
    driver="agents.ros_bridge.bags:BagCamera",
    what="a bag of ROS 1 or 2, also as MCAP",
    gives="colour and depth",
    needs="the bag",
    missing=lambda: absent("rosbags", "xxhash", "cv2"),
    extra="ros",
    example=("bag=my_bag",),
)
DYNAMIXEL = ArmEntry(
    driver="agents.dynamixel:DynamixelArm",
    what="an arm of Dynamixel servos (protocol 2.0)",
    gives="joints",
    needs="the serial line to the servos",
    missing=lambda: absent("dynamixel_sdk", "ruckig"),
    extra="dynamixel",
    example=("port=/dev/ttyUSB0", 'joints=["joint1","joint2"]'),
)
ROS_ARM = ArmEntry(
    driver="agents.ros_bridge:RosArm",
    what="an arm of a robot that speaks ROS 2",
    gives="joints",
    needs="JointState, a FollowJointTrajectory controller, and the router of rmw_zenoh",
    missing=lambda: absent("rosbags", "xxhash"),
    extra="ros",
    example=('joints=["joint_1","joint_2"]',),
)
RECORDING = CameraEntry(
    driver="agents.cameras:RecordedCamera",
    what="a recording of a run (dsr record)",
    gives="colour and depth",
    needs="the recording",
    missing=lambda: absent("cv2"),
    extra="sim",
    example=("recording=runs/mine",),
)
PLANT = CameraEntry(
    driver="agents.plant.driver:PlantCamera",
    what="a simulated camera",
    gives="colour and depth",
    needs="a running system with the agent plant: --graph NAME",
    missing=list,
    extra="sim",
    on_bus=True,
)
