"""What a replica counts of the faults that it has met."""

from __future__ import annotations

from typing import NamedTuple


class Statistics(NamedTuple):
    """Counts of the faults that a replica has met since it began; all of them are repaired."""

    repairs: int
    """Number of requests to peers for missed changes."""
    outbox_overflows: int
    """Number of times when too many changes waited for a congested network, and were left to the repair."""
    skipped: int
    """Messages passed over because merging could not keep up."""
    forgotten: int
    """Writes that came so long before their node that they were forgotten."""
    malformed: int
    """Messages that made no sense, from all senders."""
    far_stamps: int
    """Values that came stamped days ahead of this clock, from all agents."""
    passed_over: int
    """Claims beyond what is taken from one sender (`replication.claims`), and replicas beyond those listened to."""
    new_ids: int
    """Number of times when somebody spoke in the replica's name, so that it took another id."""
