"""Runs the toy agent Broken."""

from toy_agents import Broken

from dsr import main

__all__ = ["Broken"]

if __name__ == "__main__":
    main(Broken)
