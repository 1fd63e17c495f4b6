"""Runs the scene set-up as a process."""

from agents.scene_setup.agent import SceneSetup
from dsr import main

main(SceneSetup)
