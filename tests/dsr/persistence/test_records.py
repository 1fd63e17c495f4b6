"""Files of records: wherever a crash cuts them or a disk spoils them, what stands before is read, and nothing else."""

from __future__ import annotations

from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dsr.persistence.records import HEADER, append_record, read_records

PAYLOADS = [b"", b"a", b"bc" * 20, b"\x00" * 9, b"last"]


def written(file: Path) -> list[int]:
    """A file with the payloads; where each record ends."""
    ends = [len(HEADER)]
    with file.open("wb") as out:
        out.write(HEADER)
        for payload in PAYLOADS:
            ends.append(ends[-1] + append_record(out, payload))
    return ends


def test_all_is_read_again(tmp_path: Path) -> None:
    ends = written(tmp_path / "f")
    assert (tmp_path / "f").stat().st_size == ends[-1]
    assert read_records(tmp_path / "f") == (PAYLOADS, "")


def test_a_file_torn_at_any_byte_gives_all_records_before(tmp_path: Path) -> None:
    ends = written(tmp_path / "f")
    data = (tmp_path / "f").read_bytes()
    for length in range(len(data) + 1):
        (tmp_path / "torn").write_bytes(data[:length])
        payloads, problem = read_records(tmp_path / "torn")
        whole = sum(end <= length for end in ends[1:])
        assert payloads == PAYLOADS[:whole]
        assert bool(problem) == (length > len(HEADER) and length not in ends)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(position=st.integers(0, 10_000), change=st.integers(1, 255))
def test_a_changed_byte_is_found(tmp_path: Path, position: int, change: int) -> None:
    ends = written(tmp_path / "f")
    data = bytearray((tmp_path / "f").read_bytes())
    position %= len(data)
    data[position] ^= change
    (tmp_path / "f").write_bytes(data)
    payloads, problem = read_records(tmp_path / "f")
    assert problem
    assert payloads == PAYLOADS[: sum(end <= position for end in ends[1:])]
