"""Runs the toy agent Sleepy."""

from toy_agents import Sleepy

from dsr import main

__all__ = ["Sleepy"]

if __name__ == "__main__":
    main(Sleepy)
