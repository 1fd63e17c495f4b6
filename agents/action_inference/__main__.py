"""Runs the inference of actions as a process."""

from agents.action_inference.agent import ActionInference
from dsr import main

main(ActionInference)
