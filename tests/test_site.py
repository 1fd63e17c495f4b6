"""The documentation as a site: builds without a broken link, describes all public names, needs no network."""

from __future__ import annotations

import html
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer

import dsr
from dsr.cli import main as command_line
from dsr.graph.schema import Schema

ROOT = Path(__file__).parents[1]
_LOADED = re.compile(
    r"<(?:script|img|iframe)[^>]*\bsrc=.?(?:https?:)?//|<link[^>]*\bhref=.?(?:https?:)?//[^>]*\brel=.?stylesheet"
    r"|<link[^>]*\brel=.?stylesheet[^>]*\bhref=.?(?:https?:)?//"
)
"""Scripts, pictures and style sheets of other places."""
_WRONG = """
INHERIT: {root}/mkdocs.yml
docs_dir: pages
hooks: []
plugins: []
nav: [index.md]
"""


def build(folder: Path, site: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(site)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, made anew; broken links, missing anchors and pages in no menu fail here."""
    folder = tmp_path_factory.mktemp("site")
    result = build(ROOT, folder)
    assert result.returncode == 0, result.stderr
    return folder


def anchors(page: Path) -> set[str]:
    return set(re.findall(r'<h\d[^>]* id="([^"]+)"', page.read_text(encoding="utf-8")))


def test_every_page_is_built_with_its_pictures(site: Path) -> None:
    pages = [file.relative_to(ROOT / "docs") for file in ROOT.glob("docs/**/*.md")]
    assert not [page for page in pages if not (site / page.with_suffix(".html")).is_file()]
    assert (site / "images/demo.png").is_file() and not (site / "hooks").exists()


def test_the_root_s_files_are_pages_and_link_to_pages(site: Path) -> None:
    text = (site / "explanation/architecture.html").read_text(encoding="utf-8")
    assert 'href="../how-to/arm.html"' in text and ".md)" not in text
    assert 'href="architecture.html"' in (site / "explanation/follow.html").read_text(encoding="utf-8")


def test_lists_are_lists(site: Path) -> None:
    for source in (ROOT / "ARCHITECTURE.md", *ROOT.glob("docs/how-to/*.md"), *ROOT.glob("docs/tutorials/*.md")):
        page = source.relative_to(ROOT / "docs") if "docs" in source.parts else Path("explanation/architecture.md")
        text = re.sub(r"^```.*?^```$", "", source.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
        shown = (site / page.with_suffix(".html")).read_text(encoding="utf-8")
        article = shown.partition("<article")[2].partition("</article>")[0]
        assert article.count("<li>") == len(re.findall(r"^ *(?:[-*]|\d+\.) ", text, re.MULTILINE)), page


def test_all_public_names_are_described(site: Path) -> None:
    described = {anchor.rpartition(".")[2] for anchor in anchors(site / "reference/api.html")}
    assert set(dsr.__all__) <= described
    assert {"add_node", "transform", "fork", "put_frame"} <= described


def test_all_commands_and_types_are_described(site: Path) -> None:
    commands = typer.main.get_command(command_line.app)
    page = site / "reference/commands.html"
    assert set(commands.commands) <= anchors(page)  # type: ignore[attr-defined]
    assert "<debug|info|warning|error>" in html.unescape(page.read_text(encoding="utf-8"))
    text = (site / "reference/schema.html").read_text(encoding="utf-8")
    known = Schema()
    names = {*known.node_types, *known.edge_types, *known.attributes}
    assert not [name for name in names if f"<code>{name}</code>" not in text]


def test_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    wanted = [page.name for page in site.glob("**/*.html") if _LOADED.search(page.read_text(encoding="utf-8"))]
    assert not wanted


@pytest.mark.parametrize(
    ("pages", "said"),
    [
        ({"index.md": "[there](nowhere.md)"}, "nowhere.md"),
        ({"index.md": "[there](#nowhere)"}, "#nowhere"),
        ({"index.md": "# Start", "lost.md": "# Lost"}, "lost.md"),
    ],
)
def test_links_to_nowhere_and_lost_pages_are_errors(pages: dict[str, str], said: str, tmp_path: Path) -> None:
    (tmp_path / "pages").mkdir()
    (tmp_path / "mkdocs.yml").write_text(_WRONG.format(root=ROOT), encoding="utf-8")
    for name, text in pages.items():
        (tmp_path / "pages" / name).write_text(text, encoding="utf-8")
    result = build(tmp_path, tmp_path / "site")
    assert result.returncode == 1 and said in result.stderr, result.stderr
