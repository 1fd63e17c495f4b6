"""The viewer as a process."""

from agents.viewer.agent import Viewer
from dsr.agent import main

main(Viewer)
