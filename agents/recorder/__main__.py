"""The recorder as a process."""

from agents.recorder.agent import Recorder
from dsr import main

main(Recorder)
