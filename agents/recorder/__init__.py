"""Records everything that travels in a graph, as an MCAP file."""

from agents.recorder.agent import Recorder, RecorderConfig
from agents.recorder.reader import Recording, RecordingError, read_recording

__all__ = ["Recorder", "RecorderConfig", "Recording", "RecordingError", "read_recording"]
