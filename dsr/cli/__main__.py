"""`python -m dsr.cli` is `dsr`."""

from dsr.cli import start

start()
