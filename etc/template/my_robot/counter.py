"""Counts the boxes in view, and tells the table."""

import msgspec

from dsr import Access, Agent, main


class CounterConfig(msgspec.Struct, frozen=True):
    """Which boxes count."""

    smallest: float = 0.0
    """m, shortest edge"""


class Counter(Agent):
    """Writes the attribute `seen` of the table."""

    name = "counter"
    rate_hz = 5.0
    Config = CounterConfig
    reads = Access(nodes=("box",), attributes=("perceived", "size"))
    writes = Access(nodes=("table",), attributes=("seen",))

    def tick(self, now: float) -> None:
        """Count, and write if the number has changed."""
        boxes = [box for box in self.memory.nodes("box") if box.get("perceived")]
        count = sum(min(box["size"]) >= self.config.smallest for box in boxes)
        table = self.memory.get_node("table")
        if table is not None and table.get("seen") != count:
            self.memory.update_node("table", seen=count)


if __name__ == "__main__":
    main(Counter)
