"""`dsr hub`: a Zenoh router in which processes on several machines meet."""

from __future__ import annotations

import threading
from typing import Annotated

import typer

from dsr.cli.common import SecurityOption, console, shown
from dsr.connecting import identity_of
from dsr.errors import ConfigError
from dsr.network.zenoh_transport import ZenohTransport
from dsr.security.renewal import watch_certificate

app = typer.Typer()
NAME = "hub"
"""Name of the hub in its certificate."""


@app.command()
def hub(
    listen: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT",
            help="Where to be reached; tcp/0.0.0.0:7447 is open to every machine. Default: port 7447 of this one.",
        ),
    ] = None,
    connect: Annotated[
        list[str] | None, typer.Option(metavar="ENDPOINT", help="Another router to join; may be repeated.")
    ] = None,
    security: SecurityOption = None,
) -> None:
    """Connect machines: run this on one of them until Ctrl-C, and give its address to the processes on all.

    It holds no graph and may be stopped and started again at any time: processes on one machine go on
    without it, and machines catch up with each other when it is back. An ordinary Zenoh router does as well.

    Example: dsr hub --listen tcp/192.168.0.7:7447, then anywhere: dsr run tabletop --connect tcp/192.168.0.7:7447
    """
    identity = identity_of(NAME, security)
    if identity is not None and not identity.grant.relay:
        raise ConfigError(f"the certificate of {NAME!r} is not one of a relay: dsr security add FOLDER {NAME} --relay")
    place = listen or f"{'tls' if identity else 'tcp'}/127.0.0.1:7447"
    transport = ZenohTransport(place, connect or (), identity.zenoh if identity else {}, routing=True)
    if identity is not None:
        watch_certificate(transport, identity)
    console.print(f"routing at [bold]{shown(place)}[/], Ctrl-C stops", soft_wrap=True)
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        pass
    finally:
        transport.close()
