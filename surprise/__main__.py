"""Runs the surprise detector as a process."""

from dsr import main
from surprise.agent import SurpriseDetector

main(SurpriseDetector)
