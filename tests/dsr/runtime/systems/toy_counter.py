"""Runs the toy agent Counter."""

from toy_agents import Counter

from dsr import main

__all__ = ["Counter"]

if __name__ == "__main__":
    main(Counter)
