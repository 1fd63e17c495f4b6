"""What libraries that hold shared documents or scene graphs have in common, and which of them are installed.

Each holds the workload's content in its own natural form: a map of nodes, each a map of five attributes (pycrdt, Loro),
or objects with five fields (Spark-DSG, which has no merge of single changes).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from benchmarks.group import Run


class Document(ABC):
    """The content, without network; every operation is done for all nodes once."""

    name: str

    @abstractmethod
    def insert(self) -> None:
        """Insert all nodes, with attributes, into a new document."""

    @abstractmethod
    def insert_bare(self) -> None:
        """Insert all nodes, without attributes, into a new document."""

    @abstractmethod
    def update(self) -> None:
        """Set one attribute of each node of a full document, one transaction each."""

    @abstractmethod
    def get_node(self) -> None:
        """Get each node of a full document."""

    @abstractmethod
    def snapshot(self, nodes: int) -> Callable[[], None]:
        """A function that loads a new document of `nodes` nodes from bytes."""


class Replicated(Document):
    """A document whose changes can be merged into another."""

    @abstractmethod
    def replicate(self) -> None:
        """As `update`, and after each write export the change and import it into another document."""


def installed(run: Run) -> list[Document]:
    """The documents whose libraries are installed."""
    found: list[Document] = []
    if run.has("spark_dsg"):
        from benchmarks.peers.spark_document import SparkDocument

        found.append(SparkDocument())
    return [*found, *replicated(run)]


def replicated(run: Run) -> list[Replicated]:
    """Those that merge changes."""
    found: list[Replicated] = []
    if run.has("pycrdt"):
        from benchmarks.peers.pycrdt_document import PycrdtDocument

        found.append(PycrdtDocument())
    if run.has("loro"):
        from benchmarks.peers.loro_document import LoroDocument

        found.append(LoroDocument())
    return found
