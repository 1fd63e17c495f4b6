"""A part of the million messages of `benchmarks.fuzz`; and that a decoder that lets exceptions out is found."""

from __future__ import annotations

import logging
from pathlib import Path
from unittest import mock

import msgspec
import pytest

from benchmarks.fuzz import corpus, keys
from benchmarks.fuzz.__main__ import fuzz
from benchmarks.fuzz.decoders import Target, fuzz_decoder
from benchmarks.fuzz.ros import fuzz_ros
from benchmarks.fuzz.tally import Tally
from dsr.errors import WireError
from dsr.replication.sync import Synchroniser
from dsr.runtime.status import Status


def test_nothing_gets_through_and_nothing_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", "")  # to be restored
    logging.getLogger("agents").addHandler(logging.NullHandler())
    tallies: dict[str, Tally] = {tally.name: tally for tally in fuzz(50_000, seed=1)}
    assert len(tallies) == 34 and sum(tally.messages for tally in tallies.values()) >= 49_000
    assert [tally for tally in tallies.values() if not tally.passed] == []
    assert all(tally.refused for name, tally in tallies.items() if "endpoint" not in name and "state" not in name)


def test_nothing_gets_through_from_ros() -> None:
    tallies = {tally.name: tally for tally in fuzz_ros(5000, seed=2)}
    assert len(tallies) == 5 and sum(tally.messages for tally in tallies.values()) == 5000
    assert [tally for tally in tallies.values() if not tally.passed] == []
    assert tallies["ROS message"].refused > 500 and tallies["ROS transforms"].refused > 100


def test_a_decoder_that_lets_other_exceptions_out_is_found(tmp_path: Path) -> None:
    def careless(payload: bytes) -> Status:
        try:
            return msgspec.msgpack.decode(payload, type=Status)
        except msgspec.MsgspecError as error:
            raise WireError(str(error)) from error

    *_, tally = fuzz_decoder(Target("status", careless, corpus.statuses(), 1.0), 3000, seed=1)
    assert tally.exceptions and not tally.passed


def test_a_state_that_changes_by_refused_messages_is_found() -> None:
    """A memory that joins what it can read of a message and then complains."""

    def careless(self: Synchroniser, sender: str, payload: bytes, physical: float) -> None:
        self.graph.store.context.add((sender, 1))

    with mock.patch.object(Synchroniser, "receive_delta", careless):
        tallies = {tally.name: tally for tally in keys.fuzz_keys(2000, seed=1)}
    assert tallies["key d/ (deltas)"].changes and tallies["key d/ (deltas)"].miscounted


def test_growth_counts_as_a_failure() -> None:
    assert Tally("x").passed and not Tally("x", growth=400 * 1024 * 1024).passed
