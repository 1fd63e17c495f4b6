"""Runs the camera as a process."""

from agents.fixed_camera.agent import FixedCamera
from dsr.agent import main

main(FixedCamera)
