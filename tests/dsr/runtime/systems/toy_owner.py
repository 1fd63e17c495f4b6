"""Runs the toy agent Owner."""

from toy_agents import Owner

from dsr import main

__all__ = ["Owner"]

if __name__ == "__main__":
    main(Owner)
