"""The viewer as a process."""

from agents.viewer.agent import Viewer
from dsr import main

main(Viewer)
