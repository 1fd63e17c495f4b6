"""Processes that are forked ahead: each waits for its order with all libraries loaded, whose memory all share.

A process that is started anew imports for half a second what its launcher has imported already, and keeps its own copy
of it. Only a process without threads can be forked: a lock that another thread held would stay locked for ever.
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import gc
import importlib
import importlib.util
import logging
import os
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

import msgspec

PYTHON = (sys.executable, "-P", "-m")  # -P: a folder called dsr where we are is not this one
"""What runs a module, in front of its name and arguments."""
_TASKS = Path("/proc/self/task")
_FILES = Path("/proc/self/fd")
_NAME = Path("/proc/self/comm")
_MOST_NAME = 15  # characters of a process's name that the kernel keeps
_MOST_FILES = 8  # that one order passes on
_FIRST_FILE = 3  # after the standard streams
_PIECE = 1 << 16  # bytes of an order that are read at once
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_INTERRUPTED = 128 + signal.SIGINT  # exit code, as in shells


class _Order(msgspec.Struct, frozen=True):
    """What a forked process is to be. With it come open files: its standard input, its output, and `descriptors`."""

    module: str
    arguments: list[str]
    environment: list[tuple[bytes, bytes]]
    descriptors: list[int]
    """The numbers under which the process expects them."""
    name: str


class Process:
    """A process that was forked, as `subprocess.Popen` shows one that was started anew.

    Args:
        pid: its id.
        connection: on which it waits for its order.
    """

    def __init__(self, pid: int, connection: socket.socket) -> None:
        self.pid = pid
        self.stdin: BinaryIO | None = None
        """The other end of its standard input."""
        self._connection = connection
        self._code: int | None = None

    def begin(
        self,
        command: Sequence[str],
        name: str,
        output: int,
        environment: Mapping[str, str],
        descriptors: Collection[int] = (),
    ) -> None:
        """Let it run a module.

        Args:
            command: `PYTHON`, the module and its arguments.
            name: by which programs such as `top` show it; of its arguments they show those of this process.
            output: open file, for all that it prints.
            environment: all of it.
            descriptors: of open files that it also gets.
        """
        module, *arguments = command[len(PYTHON) :]
        pairs = [(os.fsencode(name), os.fsencode(value)) for name, value in environment.items()]
        order = msgspec.msgpack.encode(_Order(module, arguments, pairs, list(descriptors), name))
        theirs, ours = os.pipe()
        self.stdin = os.fdopen(ours, "wb")
        with self._connection as connection, contextlib.suppress(BrokenPipeError, ConnectionResetError):
            sent = socket.send_fds(connection, [order], [theirs, output, *descriptors])
            connection.sendall(order[sent:])
        os.close(theirs)

    def dismiss(self) -> None:
        """Let a process end that got no order."""
        self._connection.close()
        self.wait()

    def terminate(self) -> None:
        """Ask it to end."""
        if self._code is None:
            os.kill(self.pid, signal.SIGTERM)

    def wait(self) -> int:
        """Wait for its end; returns the exit code, negative for a signal."""
        if self._code is None:
            self._code = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return self._code


def fork_ahead(count: int) -> list[Process]:
    """Fork so many processes that wait for their orders; none where that is not safe, as beside threads."""
    if not _TASKS.exists() or len(list(_TASKS.iterdir())) > 1 or None in (sys.stdin, sys.stdout, sys.stderr):
        return []
    for module in ("dsr.runtime.__main__", "dsr.runtime.shared_process", "dsr.network.zenoh_transport"):
        importlib.import_module(module)
    if len(list(_TASKS.iterdir())) > 1:
        return []
    gc.freeze()  # the search for garbage would write to the memory that all share
    sys.stdout.flush()
    sys.stderr.flush()
    forked: list[Process] = []
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)  # none may end a fork as if it were this process
    try:
        for _ in range(count):
            ours, theirs = socket.socketpair()
            pid = os.fork()
            if pid == 0:
                _live([ours, *(other._connection for other in forked)], theirs, mask)
            theirs.close()
            ours.recv(1)  # it leads a group by now, by which it can be ended with all that it starts
            forked.append(Process(pid, ours))
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    return forked


def _live(of_the_parent: Sequence[socket.socket], connection: socket.socket, mask: Collection[int]) -> None:
    """The whole life of a forked process, which lets signals through but those of a mask; does not return."""
    code = 1
    try:
        os.setsid()
        for other in of_the_parent:
            other.close()
        _close_all_but(connection.fileno())
        _forget_the_parent()
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        connection.send(b".")
        if (order := _receive(connection)) is None:
            os._exit(0)
        code = _exit_code(order)
        threading._shutdown()  # type: ignore[attr-defined]
        atexit._run_exitfuncs()
    except BaseException:
        traceback.print_exc()
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _close_all_but(connection: int) -> None:
    """Close what this process has open beside its standard streams and a connection, as a new program would."""
    for number in [int(file.name) for file in _FILES.iterdir()]:
        if number >= _FIRST_FILE and number != connection:
            with contextlib.suppress(OSError):  # the list itself
                os.close(number)


def _forget_the_parent() -> None:
    """Undo what the parent has set up for itself, as in a new interpreter with the options of `PYTHON`."""
    for number in _ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
    logging.root.handlers.clear()
    logging.root.setLevel(logging.WARNING)
    sys.excepthook = sys.__excepthook__
    if not sys.flags.safe_path:
        del sys.path[0]  # the folder of the program, or the one where we are


def _receive(connection: socket.socket) -> _Order | None:
    """The order, once its files are in place; None if there will be none."""
    with connection:
        written, files, _, _ = socket.recv_fds(connection, _PIECE, _MOST_FILES)
        while piece := connection.recv(_PIECE):
            written += piece
    if not written:
        return None
    order = msgspec.msgpack.decode(written, type=_Order)
    first_free = max([2, *order.descriptors]) + 1
    clear = [fcntl.fcntl(file, fcntl.F_DUPFD_CLOEXEC, first_free) for file in files]
    for file in files:
        os.close(file)
    standard_input, output, *others = clear
    wanted = [(standard_input, 0), (output, 1), (output, 2), *zip(others, order.descriptors, strict=True)]
    for file, number in wanted:
        os.dup2(file, number)
    for file in clear:
        os.close(file)
    return order


def _exit_code(order: _Order) -> int:
    """Run the module of an order, as `python -m` does; returns how it ended."""
    os.environb.clear()
    os.environb.update(order.environment)
    sys.stdin, sys.stdout, sys.stderr = (
        open(number, mode, buffering=1, encoding=stream.encoding, errors=stream.errors, closefd=False)  # noqa: SIM115
        for number, mode, stream in ((0, "r", sys.stdin), (1, "w", sys.stdout), (2, "w", sys.stderr))
    )
    with contextlib.suppress(OSError):
        _NAME.write_text(order.name[:_MOST_NAME], encoding="utf-8")
    module = sys.modules["__main__"] = importlib.import_module(_main_module(order.module))
    sys.argv = [module.__file__ or order.module, *order.arguments]
    try:
        return int(module.main())
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            return end.code or 0
        sys.stderr.write(f"{end.code}\n")
        return 1
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BaseException:
        traceback.print_exc()
        return 1


def _main_module(module: str) -> str:
    """What `python -m` runs of a module: of a package, its `__main__`."""
    spec = importlib.util.find_spec(module)
    return f"{module}.__main__" if spec is not None and spec.submodule_search_locations else module
