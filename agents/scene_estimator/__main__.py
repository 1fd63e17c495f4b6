"""Runs the scene estimator as a process."""

from agents.scene_estimator.agent import SceneEstimator
from dsr import main

main(SceneEstimator)
