"""Types of command line options that several benchmarks have: whole numbers with a least one, and seeds."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from agents.scenario.options import parse_seeds
from dsr.errors import ConfigError


def whole_number(least: int) -> Callable[[str], int]:
    """A whole number, not less than `least`, for `type=` of an option."""

    def number(text: str) -> int:
        if int(text) < least:
            raise argparse.ArgumentTypeError(f"{text}: expected {least} or more")
        return int(text)

    number.__name__ = "whole number"
    return number


def seeds(text: str) -> list[int]:
    """Seeds such as `0-9` or `3,7`, for `type=` of an option."""
    try:
        return parse_seeds(text)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error).removeprefix("--seeds ")) from None
