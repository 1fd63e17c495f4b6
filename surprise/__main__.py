"""Runs the surprise detector as a process."""

from dsr.agent import main
from surprise.agent import SurpriseDetector

main(SurpriseDetector)
