"""Runs the toy agent Deaf."""

from toy_agents import Deaf

from dsr import main

__all__ = ["Deaf"]

if __name__ == "__main__":
    main(Deaf)
