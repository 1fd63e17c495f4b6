"""Runs the camera as a process."""

from agents.fixed_camera.agent import FixedCamera
from dsr import main

main(FixedCamera)
