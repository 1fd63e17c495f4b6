"""Records everything that travels in a graph, as MCAP files."""

from agents.recorder.agent import Recorder
from agents.recorder.config import RecorderConfig
from agents.recorder.reader import Recording, RecordingError, read_recording

__all__ = ["Recorder", "RecorderConfig", "Recording", "RecordingError", "read_recording"]
