"""The `dsr` command: start systems, and look into a running working memory."""

from dsr.cli.interrupts import end_at_once


def start() -> None:
    """Run the command line; if its own libraries are not installed, say how to install them."""
    end_at_once()
    import os
    import sys

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small, and a process with threads cannot fork
    from dsr.cli.streams import open_closed_streams
    from dsr.config.extras import missing_extra
    from dsr.runtime.resources import exit_if_short

    open_closed_streams()
    exit_if_short()  # before any module of a command loads a library that would crash
    try:
        from dsr.cli.main import main as run
    except ModuleNotFoundError as error:
        said = missing_extra(error)
        if said is None:
            raise
        sys.stderr.write(f"dsr: {said}\n")
        raise SystemExit(2) from None
    try:
        run()
    finally:
        end_at_once()  # the interpreter tidies up
