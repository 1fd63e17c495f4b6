"""Whether the whole system keeps its rates live, what that costs, and whether it stays as small for a day."""
