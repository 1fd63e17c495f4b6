"""Drivers of cameras whose libraries may block, and of files that look like cameras; `dsr drivers`."""

from agents.cameras.errors import CorruptFrameError, DeviceError, EndOfPicturesError
from agents.cameras.reader import CameraDevice, CameraReader
from agents.cameras.realsense import RealSense
from agents.cameras.recording import RecordedCamera
from agents.cameras.video import VideoFile
from agents.cameras.webcam import Webcam

__all__ = [
    "CameraDevice",
    "CameraReader",
    "CorruptFrameError",
    "DeviceError",
    "EndOfPicturesError",
    "RealSense",
    "RecordedCamera",
    "VideoFile",
    "Webcam",
]
