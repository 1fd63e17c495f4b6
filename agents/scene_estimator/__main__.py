"""Runs the scene estimator as a process."""

from agents.scene_estimator.agent import SceneEstimator
from dsr.agent import main

main(SceneEstimator)
