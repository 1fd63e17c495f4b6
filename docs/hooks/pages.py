"""Writes the parts of pages that follow from the code, and shows files of the project's root as pages.

A page says where such a part belongs: `<!-- generated: commands -->`, `<!-- generated: schema -->`, or
`<!-- the file CHANGELOG.md -->`. mkdocs calls `on_page_markdown` for each page.
"""

from __future__ import annotations

import html
import posixpath
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page

from dsr.cli.commands import load_command
from dsr.cli.main import app
from dsr.graph.schema import Schema

ROOT = Path(__file__).parents[2]
SHOWN = {"ARCHITECTURE.md": "explanation/architecture.md", "CHANGELOG.md": "reference/changes.md"}
"""Files of the project's root that are pages of the site, with the page of each."""
_GENERATED = re.compile(r"^<!-- generated: (\w+) -->$", re.MULTILINE)
_FILE = re.compile(r"^<!-- the file (\S+) -->$", re.MULTILINE)
_MARKER = re.compile(r"([-*]|\d+\.) +")
_LINK = re.compile(r"(?<=\]\()(?!https?:|#)([^)#\s]+)")


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Fill in what the page asks for; mkdocs calls it before it makes HTML of a page."""
    here = page.file.src_uri
    markdown = _FILE.sub(lambda found: file_as_page(found[1], here), markdown)
    markdown = _GENERATED.sub(lambda found: GENERATED[found[1]](), markdown)
    markdown = "\n".join(lists_by_four(markdown.splitlines()))
    return _LINK.sub(lambda found: _in_site(found[1], here), markdown)


def lists_by_four(lines: Iterable[str]) -> Iterator[str]:
    """Indent lists within lists as the site's Markdown wants it: by four spaces, after an empty line if they begin."""
    levels: list[int] = []  # columns at which the text of each list around begins
    before, code = "", False
    for line in lines:
        text = line.lstrip()
        indent = len(line) - len(text)
        code ^= text.startswith("```")
        marker = None if code else _MARKER.match(text)
        if text and (marker or not before):
            while levels and indent < levels[-1]:
                levels.pop()
        if marker and not levels and before:
            yield ""
        depth = "    " * len(levels)
        yield depth + line[min(indent, levels[-1]) :] if levels and text else line
        if marker:
            levels.append(indent + marker.end())
        before = "" if marker else text


def file_as_page(name: str, here: str) -> str:
    """Read a file of the project's root, with its links as they are from the page `here`."""
    text = (ROOT / name).read_text(encoding="utf-8")
    return _LINK.sub(lambda found: posixpath.relpath(found[1], posixpath.dirname(f"docs/{here}")), text)


def _in_site(link: str, here: str) -> str:
    """Turn the link to a file that is shown as a page into one to the page; others stay."""
    folder = posixpath.dirname(f"docs/{here}")
    page = SHOWN.get(posixpath.normpath(posixpath.join(folder, link)))
    return posixpath.relpath(f"docs/{page}", folder) if page else link


def commands() -> str:
    """Describe each command of `dsr` by what `--help` says."""
    group: Any = typer.main.get_command(app)
    return "\n".join(part for name in group.commands for part in _command(("dsr", name), load_command(name)))


def _command(path: tuple[str, ...], command: Any) -> Iterator[str]:
    """Yield the Markdown of a command, then of those below it."""
    context = command.make_context(" ".join(path), [], resilient_parsing=True)
    yield f"{'#' * len(path)} {' '.join(path[1:])}\n"
    yield f"`{command.get_usage(context).removeprefix('Usage: ')}`\n"
    yield "\n\n".join(_paragraphs(command.help or "")) + "\n"
    records = [record for parameter in command.params if (record := parameter.get_help_record(context))]
    shown = [(names, text) for names, text in records if not names.startswith(("--help", "-h"))]
    rows = [(f"<code>{html.escape(names)}</code>", text) for names, text in shown]
    if rows:
        yield table(("argument or option", "meaning"), rows)
    for name, below in getattr(command, "commands", {}).items():
        yield from _command((*path, name), below)


def _paragraphs(text: str) -> list[str]:
    """Give the paragraphs of a help text; those that begin with `Example:` as code."""
    paragraphs = [" ".join(paragraph.split()) for paragraph in text.split("\n\n")]
    return [re.sub(r"^Examples?: (.+)$", r"Example: `\1`", paragraph) for paragraph in paragraphs]


def schema() -> str:
    """List the types and attributes that every graph knows."""
    known = Schema()
    edges = [
        (f"`{name}`", meaning, "yes" if name in known.geometric else "") for name, meaning in known.edge_types.items()
    ]
    attributes = [
        (f"`{name}`", it.kind + ("" if it.length is None else f" of {it.length}"), it.unit, it.meaning)
        for name, it in known.attributes.items()
    ]
    return "\n".join([
        "## Node types\n", table(("type", "meaning"), _named(known.node_types)),
        "## Edge types\n", table(("type", "meaning", "carries a pose"), sorted(edges)),
        "## Attributes\n", table(("attribute", "value", "unit", "meaning"), sorted(attributes)),
    ])  # fmt: skip


def _named(meanings: Mapping[str, str]) -> list[tuple[str, str]]:
    return sorted((f"`{name}`", meaning) for name, meaning in meanings.items())


def table(heads: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """Make a table in Markdown."""
    cells = [heads, tuple("---" for _ in heads), *rows]
    lines = (" | ".join(" ".join(cell.split()).replace("|", "&#124;") for cell in row) for row in cells)
    return "\n".join(f"| {line} |" for line in lines) + "\n"


GENERATED = {"commands": commands, "schema": schema}
"""The parts that pages may ask for."""
