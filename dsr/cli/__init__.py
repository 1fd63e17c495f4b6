"""The `dsr` command: start systems, and look into a running working memory."""

import sys

from dsr.config.extras import missing_extra
from dsr.runtime.resources import exit_if_short

exit_if_short()  # before any module of a command loads a library that would crash


def start() -> None:
    """Run the command line; if its own libraries are not installed, say how to install them."""
    try:
        from dsr.cli.main import main as run
    except ModuleNotFoundError as error:
        said = missing_extra(error)
        if said is None:
            raise
        sys.stderr.write(f"dsr: {said}\n")
        raise SystemExit(2) from None
    run()
