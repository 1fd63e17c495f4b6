"""The hub of a soak test: a router in a process that ends with its standard input, and so with who started it."""

from __future__ import annotations

import sys

from dsr.network.zenoh_transport import ZenohTransport


def main() -> None:
    """Route at the endpoint that is the only argument, until the input ends."""
    transport = ZenohTransport(sys.argv[1], routing=True)
    sys.stdin.read()
    transport.close()


if __name__ == "__main__":
    main()
