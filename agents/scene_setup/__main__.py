"""Runs the scene set-up as a process."""

from agents.scene_setup.agent import SceneSetup
from dsr.agent import main

main(SceneSetup)
