"""The chain of edges between two frames and its product, renewed at the cost of what changed."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence

import msgspec

from dsr.math3d.transforms import Pose


class Link(msgspec.Struct, frozen=True, gc=False):
    """The edge that a chain takes upwards from a frame; `pose` is parent_from_frame, None if unknown then."""

    type: str
    parent: str
    pose: Pose | None


Links = dict[str, Link]
"""Frames of one edge type, each with the link that is taken upwards from it."""
Dependency = tuple[Links, str, Link | None]
"""A result holds while the table has this link at this frame."""
Find = Callable[[str], Link | None]
"""Tells the link upwards from a frame; None if there is none."""
Path = dict[str, Link | None]
"""Frames from the bottom up, each with the link to the next."""


MOST_STEPS = 256
"""Edges on the way between two frames; beyond, they are nowhere to one another. Robots and models in files have fewer.
Somebody may hang a camera below any number of frames, and each look at what it sees would go through all of them."""


def climb(frame: str, find: Find, until: Container[str]) -> Path:
    """The frames from this one up to one in `until`, or to the last, or to where they would repeat.

    It ends after `MOST_STEPS`, too, as if nothing were above.
    """
    chain: Path = {}
    while frame not in chain:
        link = chain[frame] = None if frame in until or len(chain) >= MOST_STEPS else find(frame)
        if link is None:
            break
        frame = link.parent
    return chain


def factor(link: Link, inverted: bool) -> Pose | None:
    """The pose of the link in a product: as it is, or inverted where it is taken downwards."""
    return link.pose.inverse() if inverted and link.pose is not None else link.pose


class Newest:
    """Finds links by the newest samples.

    Args:
        types: edge types in the order of preference.
        tables: one per type.
    """

    def __init__(self, types: Sequence[str], tables: Sequence[Links]) -> None:
        self._types = types
        self._tables = tables

    def find(self, frame: str) -> Link | None:
        """Find the link of the first type that has one at this frame; None if there is none."""
        for links in self._tables:
            link = links.get(frame)
            if link is not None:
                return link
        return None

    def depend(self, frame: str, link: Link | None) -> list[Dependency]:
        """List the dependencies of this answer of `find`: while they stay, `find` gives the same link.

        They are the link itself, and that no edge of a preferred type exists.
        """
        rank = len(self._types) if link is None else self._types.index(link.type)
        preferred: list[Dependency] = [(links, frame, None) for links in self._tables[:rank]]
        return preferred if link is None else [*preferred, (self._tables[rank], frame, link)]


class Chain:
    """The links between two frames as they were, and target_from_source; immutable.

    The partial products form a binary tree: the root is at 1, the factors of i are at 2 i and 2 i + 1, and
    the poses of the links are the leaves. So one changed link of n costs log2(n) products, wherever it is.

    Args:
        dependencies: those of the links in the order of the product, others anywhere between them.
        inverted: how many links, the first ones, are taken downwards.
    """

    __slots__ = ("_inverted", "_products", "dependencies", "pose")

    def __init__(self, dependencies: Sequence[Dependency], inverted: int) -> None:
        links = [link for _, _, link in dependencies if link is not None]
        leaves = [factor(link, i < inverted) for i, link in enumerate(links)]
        size = 1 << max(0, len(leaves) - 1).bit_length()
        self._set(dependencies, inverted, [None] * size + leaves + [None] * (size - len(leaves)), range(1, size))

    def _set(
        self, dependencies: Sequence[Dependency], inverted: int, products: list[Pose | None], unset: Sequence[int]
    ) -> None:
        """Take these values, after making the products at the places `unset` (ascending) from those below them."""
        for place in reversed(unset):
            left, right = products[2 * place], products[2 * place + 1]
            products[place] = left if left is None or right is None else left @ right
        self.dependencies = dependencies
        self._inverted = inverted
        self._products = products
        self.pose = products[1] or Pose.identity()

    def renewed(self) -> Chain | None:
        """The chain by the present links; None if it leads through other frames or types now."""
        products = self._products.copy()
        dependencies: list[Dependency] = []
        leaf = first = len(products) // 2
        changed: list[int] = []
        for links, frame, old in self.dependencies:
            new = links.get(frame)
            if new is not old:
                if new is None or old is None or new.parent != old.parent:
                    return None
                products[leaf] = factor(new, leaf < first + self._inverted)
                changed.append(leaf)
            dependencies.append((links, frame, new))
            leaf += old is not None
        chain = Chain.__new__(Chain)
        chain._set(dependencies, self._inverted, products, _above(changed))
        return chain


def _above(leaves: list[int]) -> Sequence[int]:
    """The places in the tree of products above these leaves, each once, in ascending order."""
    return sorted({leaf >> levels for leaf in leaves for levels in range(1, leaf.bit_length())})
