"""Tells who has picked up, put down or let go of which object: docs/explanation/actions.md.

In the order of the data: `reading` (graph to `observation`), the policy `believed` or another one, `agent`.
"""

from agents.action_inference.agent import ActionInference

__all__ = ["ActionInference"]
