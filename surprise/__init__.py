"""Where perception and belief disagree: objects and cameras that are `surprising`, and why.

Read in the order of the data: `beliefs` (what is believed, and was a moment ago), `deviation` (one percept against the
belief), `misfit` (what several of them cost), `evidence` (those of a span), `expectation` (what should be seen and is
not, and what is seen and cannot be), `improbability` (all that under the whole belief), `suspicion` (when a flag is set
and cleared), `agent`.
"""

from surprise.agent import SurpriseDetector

__all__ = ["SurpriseDetector"]
