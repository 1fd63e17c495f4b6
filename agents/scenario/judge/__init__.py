"""The judgement of a run: expectations that hold or fail, metrics, the result."""
