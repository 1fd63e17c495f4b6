"""Prints the scores as tables, and as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.table import Table

from benchmarks.honesty.errors import CostlyPair
from benchmarks.honesty.summary import LEVELS, Failures, NearScores, PlaceScores, RelationScores, Report, Share

Rows = list[list[str]]


def tables(report: Report) -> list[tuple[str, list[str], Rows]]:
    """Each table as its title, its headings and its rows."""
    turned = [one for one in report.places if one.turned_coverage and one.seen != "never"]
    return [
        ("Places", _PLACE_HEADINGS, _place_rows(report.places)),
        ("Whole poses of tagged things", _TURNED_HEADINGS, [_turned_row(one) for one in turned]),
        ("Relations, holders and actions", _RELATION_HEADINGS, [_relation_row(scores) for scores in report.relations]),
        ("Best guesses of the belief", _NEAR_HEADINGS, [_near_row(scores) for scores in report.near]),
        ("Where regions of 99 % miss the truth", _FAILURE_HEADINGS, [_failure_row(found) for found in report.failures]),
        ("Which relations and actions cost most", _COSTLY_HEADINGS, [_costly_row(pair) for pair in report.costly]),
    ]


def show_report(report: Report, console: Console) -> None:
    """Print all tables."""
    for title, headings, rows in tables(report):
        table = Table(title=title, title_justify="left")
        for number, heading in enumerate(headings):
            table.add_column(heading, justify="left" if number == 0 else "right", overflow="fold")
        for row in rows:
            table.add_row(*row)
        console.print(table)


def markdown(report: Report) -> str:
    """All tables in Markdown."""
    return "\n".join(_markdown_table(title, headings, rows) for title, headings, rows in tables(report))


def _markdown_table(title: str, headings: Sequence[str], rows: Rows) -> str:
    lines = [_line(headings), _line("---" for _ in headings), *map(_line, rows)]
    return f"### {title}\n\n" + "\n".join(lines) + "\n"


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


_PLACE_HEADINGS = [
    *("family", "", "moments", "nats", "of one world", "of percept", *(f"{100 * level:g} %" for level in LEVELS)),
    *("90 % sideways", "of one world", "median", "95 %", "of percept", "silent"),
]  # fmt: skip


def _place_rows(places: Sequence[PlaceScores]) -> Rows:
    """A row for each family, and for what is seen and not: the belief, and beside it the percept."""
    by_speaker = {(one.family, one.seen, one.speaker): one for one in places}
    rows = []
    for (family, seen, speaker), scores in by_speaker.items():
        if speaker == "belief" and seen != "never":
            peer, simulated = by_speaker[family, seen, "percept"], by_speaker[family, seen, "one world"]
            rows.append(
                [
                    family,
                    seen,
                    str(scores.moments),
                    _with_error(scores),
                    _with_error(simulated),
                    _with_error(peer),
                    *(_percent(scores.coverage.get(level)) for level in LEVELS),
                    _percent(scores.sideways_coverage.get(_COMPARED)),
                    _percent(simulated.coverage.get(_COMPARED)),
                    _millimetres(scores.median_error),
                    _millimetres(scores.p95_error),
                    _millimetres(peer.median_error),
                    _percent(scores.silent),
                ]
            )
    return rows


_COMPARED = 0.9
"""Mass of the regions of which the coverage sideways, and that of the simulated world, are told, too"""


def _with_error(scores: PlaceScores) -> str:
    error = scores.log_score_error
    return _number(scores.log_score) + ("" if error is None else f" ± {error:.2f}")


_TURNED_HEADINGS = ["family", "speaker", "", "nats", *(f"{100 * level:g} %" for level in LEVELS)]


def _turned_row(scores: PlaceScores) -> list[str]:
    coverage = (_percent(scores.turned_coverage.get(level)) for level in LEVELS)
    return [scores.family, scores.speaker, scores.seen, _number(scores.turned_log_score), *coverage]


_RELATION_HEADINGS = ["family", "what", "Brier", "if none told", "sure and wrong"]


def _relation_row(scores: RelationScores) -> list[str]:
    wrong = _percent(scores.sure_and_wrong)
    return [scores.family, scores.kind, f"{scores.brier:.4f}", f"{scores.silent:.4f}", wrong]


_NEAR_HEADINGS = ["family", "rests in view: 5 mm", "untouched unseen: 20 mm", "in the right thing", "never seen"]


def _near_row(scores: NearScores) -> list[str]:
    inside = (scores.contained, scores.contained_never_seen)
    return [scores.family, *map(_share, (scores.seen_at_rest, scores.untouched, *inside))]


_FAILURE_HEADINGS = ["family", "misses", "of these", "worst"]
_TOLD_KINDS = 3  # of a family, that are told


def _failure_row(found: Failures) -> list[str]:
    kinds = ", ".join(f"{kind} {100 * share:.0f} %" for kind, share in found.kinds[:_TOLD_KINDS])
    worst = ", ".join(f"{name} (seed {seed})" for seed, name, _ in found.worst)
    return [found.family, _percent(found.share), kinds or "-", "" if found.family == "all" else worst]


_COSTLY_HEADINGS = ["what", "family", "about", "cost", "missed", "sure and wrong", "from", "to"]


def _costly_row(pair: CostlyPair) -> list[str]:
    about, wrong = " ".join(pair.about), (str(pair.missed), str(pair.sure_and_wrong))
    cells = [f"{pair.cost:.1f}", *wrong, f"{pair.first:.1f} s", f"{pair.last:.1f} s"]
    return [pair.kind, f"{pair.family} (seed {pair.seed})", about, *cells]


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _share(found: Share | None) -> str:
    return "-" if found is None else f"{_percent(found.share)} of {found.of}"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f} %"


def _millimetres(length: float | None) -> str:
    return "-" if length is None else f"{1000 * length:.1f} mm"
