"""Keys, tokens, gids and attachments of rmw_zenoh: examples from its sources and documents, and their inverses."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.link.zenoh.tokens import Entity, attachment, gid, qos_key, read_attachment, read_qos, read_token

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
STRING = "std_msgs/msg/String"
CHATTER = (
    "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MP/%/%/listener/%chatter/std_msgs::msg::dds_::String_/"
    f"{HASH}/::,10:,:,:,,"
)
"""After the design document of rmw_zenoh, with the hash of this type"""


def test_the_token_of_the_design_document() -> None:
    session = "aac3178e146ba6f1fc6e6a4085e77f21"
    entity = Entity("publisher", 0, session, 0, 10, "/listener", "/chatter", STRING, HASH, Qos())
    assert entity.token() == CHATTER and read_token(CHATTER) == entity
    assert entity.key() == f"0/chatter/std_msgs::msg::dds_::String_/{HASH}"
    node = Entity("node", 2, "aac3", 1, 1, "/arm/driver")
    assert node.token() == "@ros2_lv/2/aac3/1/1/NN/%/%arm/driver" and read_token(node.token()) == node


def test_qos_of_known_profiles() -> None:
    assert qos_key(Qos(depth=42)) == "::,:,:,:,,"
    assert qos_key(Qos(depth=10)) == "::,10:,:,:,,"
    assert qos_key(Qos(transient_local=True, depth=1)) == ":1:,1:,:,:,,"
    assert qos_key(Qos(reliable=False, depth=5)) == "2::,5:,:,:,,"
    assert read_qos("::2,:,:,:,,").depth > 10**9  # keep all
    assert read_qos("1:2:1,7:9,9:,:1,,") == Qos(depth=7)


@given(st.booleans(), st.booleans(), st.integers(0, 10**6), st.sampled_from(["/a", "/a/b_1", "/x/y/z"]))
def test_tokens_tell_what_was_told(reliable: bool, kept: bool, depth: int, name: str) -> None:
    for kind in ("publisher", "subscriber", "service", "client"):
        qos = Qos(reliable, kept, depth)
        entity = Entity(kind, 3, "f0", 0, 4, f"/ns{name}", name, STRING, HASH, qos)  # type: ignore[arg-type]
        assert read_token(entity.token()) == entity == read_token(entity.token() + "/backends")


@given(st.text(alphabet="@ros2_lv/0123NMPS%:, abc*", max_size=80) | st.text(max_size=80))
def test_any_other_text_is_no_token(text: str) -> None:
    assert read_token(text) is None or text.startswith("@ros2_lv/")


@given(st.integers(0, len(CHATTER) - 1), st.text(max_size=6))
def test_broken_tokens_raise_nothing(place: int, other: str) -> None:
    read_token(CHATTER[:place] + other + CHATTER[place + len(other) :])


@pytest.mark.parametrize("number", ["-1", "1e3", "9" * 30, "\u0663", "", " 1"])
def test_numbers_of_tokens_are_bounded(number: str) -> None:
    assert read_token(CHATTER.replace("/0/10/", f"/0/{number}/")) is None


def test_types_of_other_names_keep_them() -> None:
    token = CHATTER.replace("std_msgs::msg::dds_::String_", "my::Own")
    entity = read_token(token)
    assert entity is not None and entity.type == "my::Own" and "/my::Own/" in entity.key()


def test_attachments_have_33_bytes() -> None:
    made = attachment(1, 0x17_97_9C_FE_3D_85_CD_15, bytes(range(16)))
    assert made.hex() == "0100000000000000" + "15cd853dfe9c9717" + "10" + bytes(range(16)).hex()
    assert read_attachment(made) == (1, 0x17_97_9C_FE_3D_85_CD_15, bytes(range(16)))
    for wrong in (b"", made[:-1], made + b"\0", made[:16] + b"\x0f" + made[17:]):
        with pytest.raises(RosMessageError):
            read_attachment(wrong)


def test_the_gid_is_xxh3_of_the_token() -> None:
    """The value of the empty text is in the tests of xxHash: low 64 bits 6001c324468d497f, high 99aa06d3014798d8."""
    assert gid("").hex() == "7f498d4624c30160" + "d8984701d306aa99"
