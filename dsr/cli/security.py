"""`dsr security`: make certificates for the agents of a system, and say who may write what."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from dsr.cli.common import JsonOption, add_names, console, print_json, shown
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError
from dsr.runtime.system import load_class, load_system
from dsr.security.authority import CERTIFICATE_DAYS, SecurityFolder, host_names
from dsr.security.configuration import write_configuration
from dsr.security.policy import (
    AccessPolicy,
    Grant,
    checked,
    grant_for,
    read_policy,
    standard_grants,
    system_grants,
    write_policy,
)

app = typer.Typer(
    name="security", no_args_is_help=True, help="Certificates and rules: who may take part, and who may write what."
)

FolderArgument = Annotated[Path, typer.Argument(help="The security folder. It holds private keys.")]
HostOption = Annotated[
    list[str] | None, typer.Option("--host", help="Another name or address of this machine; may be repeated.")
]
DaysOption = Annotated[int, typer.Option(min=1, help="How long the certificates are valid.")]
_PARTS = {"node": "nodes", "edge": "edges", "attribute": "attributes", "key": "publishes"}


@app.command()
def init(
    folder: FolderArgument,
    system: Annotated[str | None, typer.Option(help="A system whose agents get what their classes declare.")] = None,
    agent: Annotated[list[str] | None, typer.Option(help="Another agent, that may write everything.")] = None,
    viewer: Annotated[list[str] | None, typer.Option(help="A member that may only read.")] = None,
    no_import: Annotated[
        bool, typer.Option("--no-import", help="Import no modules beside the file of the system: for files of others.")
    ] = False,
    host: HostOption = None,
    days: DaysOption = CERTIFICATE_DAYS,
) -> None:
    """Make a certificate authority, and a certificate for each agent.

    Besides the agents named, the launcher gets one, and `dsr`: the command line tools, which only read.
    To know what agents declare, --system imports their classes, which runs the modules beside the file, too.

    Example: dsr security init keys --system tabletop, then: dsr run tabletop --security keys
    """
    grants = system_grants(load_system(system, beside=not no_import)) if system else standard_grants()
    everything = Grant(("*",), ("*",), ("*",), ("device/**", "blob/**"))
    policy = checked({
        **grants,
        **dict.fromkeys(agent or (), everything),
        **dict.fromkeys(viewer or (), Grant(read_only=True)),
    })  # fmt: skip
    host_names(host or ())
    files = SecurityFolder(folder)
    files.create(WALL_CLOCK.now())
    for name in policy.agents:
        files.issue(name, WALL_CLOCK.now(), days=days, hosts=host or ())
    _save(files, policy)
    console.print(f"{len(policy.agents)} certificates in [bold]{shown(str(folder))}[/]; {_KEEP}", soft_wrap=True)


_KEEP = "ca.key is only needed to make more of them: keep it where no agent runs"


@app.command()
def add(
    folder: FolderArgument,
    name: Annotated[str, typer.Argument(help="The agent's name.")],
    kind: Annotated[str | None, typer.Option("--class", help="MODULE:CLASS; it may write what that declares.")] = None,
    writes: Annotated[
        list[str] | None,
        typer.Option(help="What it may write: node:TYPE, edge:TYPE, attribute:NAME or key:KEY; may be repeated."),
    ] = None,
    read_only: Annotated[bool, typer.Option("--read-only", help="It may only read.")] = False,
    trusted: Annotated[bool, typer.Option("--trusted", help="It may hand on what others wrote.")] = False,
    relay: Annotated[bool, typer.Option("--relay", help="It routes between machines, on keys of all others.")] = False,
    renew: Annotated[bool, typer.Option("--renew", help="Replace the certificate that it has.")] = False,
    host: HostOption = None,
    days: DaysOption = CERTIFICATE_DAYS,
) -> None:
    """Add an agent, or renew its certificate.

    Running processes take over a renewed certificate within ten seconds. They know of a new agent, and of other
    grants, when they are started again.

    Example: dsr security add keys counter --writes node:table --writes attribute:seen
    """
    files = SecurityFolder(folder)
    policy = read_policy(files.policy)
    if (name in policy.agents) is not renew:
        known = "is there already; give --renew for a new certificate" if not renew else "is not there yet"
        raise ConfigError(f"agent {name!r} {known}")
    before = policy.agents.get(name)
    roles = Grant(read_only=read_only, trusted=trusted, relay=relay)
    grant = _grant(kind, writes or [], roles)
    if renew and grant == Grant() and kind is None:
        grant = policy.grant(name)
    policy = checked({**policy.agents, name: grant})
    files.issue(name, WALL_CLOCK.now(), days=days, hosts=host or ())
    _save(files, policy)
    until = files.expiry(name)
    advice = "what runs takes it over" if renew and grant == before else "start what runs again"
    console.print(f"[bold]{name}[/] has a certificate until {until:%Y-%m-%d}; {advice}", soft_wrap=True)


def _grant(kind: str | None, writes: list[str], roles: Grant) -> Grant:
    """The roles, with what the class declares and what `writes` adds."""
    grant = grant_for(load_class(kind, Path.cwd())) if kind else Grant()
    given: dict[str, tuple[str, ...]] = {part: getattr(grant, part) for part in _PARTS.values()}
    for text in writes:
        what, _, name = text.partition(":")
        if what not in _PARTS or not name:
            raise ConfigError(f"--writes {text!r}: expected {':NAME, '.join(_PARTS)}:NAME")
        given[_PARTS[what]] += (name,)
    return msgspec.structs.replace(roles, **given)


def _save(files: SecurityFolder, policy: AccessPolicy) -> None:
    """Write the policy and, since each holds the rules for all, every agent's configuration."""
    write_policy(files.policy, policy)
    for name in policy.agents:
        write_configuration(files, policy, name)


@app.command()
def show(folder: FolderArgument, as_json: JsonOption = False) -> None:
    """Show who may write what, and until when their certificates are valid.

    The exit code is 1 if a certificate cannot be used.
    """
    files = SecurityFolder(folder)
    policy = read_policy(files.policy)
    problems = {name: _problem(files, name) for name in policy.agents}
    if as_json:
        print_json([
            {"agent": name, "until": None if problems[name] else f"{files.expiry(name):%Y-%m-%d}",
             "problem": problems[name], **{part: getattr(grant, part) for part in Grant.__struct_fields__}}
            for name, grant in policy.agents.items()
        ])  # fmt: skip
    else:
        console.print(_table(files, policy, problems))
    raise typer.Exit(1 if any(problems.values()) else 0)


def _problem(files: SecurityFolder, name: str) -> str | None:
    try:
        files.check(name, WALL_CLOCK.now())
    except ConfigError as error:
        return str(error)
    return None


def _table(files: SecurityFolder, policy: AccessPolicy, problems: dict[str, str | None]) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "agent", "may write", "valid until")
    for name, grant in policy.agents.items():
        problem = problems[name]
        until = f"[red]{shown(problem)}[/]" if problem else f"{files.expiry(name):%Y-%m-%d}"
        table.add_row(shown(name), shown(_readable(grant)), until)
    return table


def _readable(grant: Grant) -> str:
    if grant.read_only:
        return "nothing: read only"
    lines = [f"{part}: {', '.join(names)}" for part in _PARTS.values() if (names := getattr(grant, part))]
    lines += ["trusted: hands on what others wrote"] if grant.trusted else []
    lines += ["relay: routes between machines"] if grant.relay else []
    return "\n".join(lines) or "its own status and log"
