"""Where perception and belief disagree: objects and cameras that are `surprising`, and why.

Read in the order of the data: `beliefs` (what is believed, and was a moment ago), `deviation` (one percept against the
belief), `limits` (when that counts), `evidence` (several of them), `expectation` (what should be seen and is not, and
what is seen and cannot be), `suspicion` (when a flag is set and cleared), `agent`.
"""

from surprise.agent import SurpriseDetector

__all__ = ["SurpriseDetector"]
