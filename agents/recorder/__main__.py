"""The recorder as a process."""

from agents.recorder.agent import Recorder
from dsr.agent import main

main(Recorder)
