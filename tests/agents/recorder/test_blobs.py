"""Blobs wait for the recorder: bounded, whatever streams are made up, and nothing that is lost goes uncounted."""

from __future__ import annotations

from agents.recorder import blobs
from agents.recorder.blobs import BlobInbox
from agents.recorder.selection import IMAGE
from dsr import LocalNetwork, ManualClock


def test_images_of_made_up_streams_take_no_memory_and_those_lost_are_counted() -> None:
    clock = ManualClock()
    network = LocalNetwork(clock)
    sender, inbox = network.connect("sender"), BlobInbox(network.connect("recorder"), "blob/**", clock, most=10)
    for number in range(2 * blobs._MOST_IMAGES):
        sender.publish_bulk(f"blob/made_up_{number}", [bytes(IMAGE)])
    sender.publish_bulk("blob/made_up_0", [b"x" * IMAGE])
    network.deliver()
    assert inbox.dropped == blobs._MOST_IMAGES
    images = inbox.take_images()
    assert len(images) == blobs._MOST_IMAGES
    assert images[0].payload == b"x" * IMAGE, "the newest of its stream"
    assert inbox.take_images() == []
    for number in range(15):
        sender.publish_bulk("blob/poses", [b"%d" % number])
    network.deliver()
    assert [message.payload for message in inbox.take()] == [b"%d" % number for number in range(5, 15)]
    assert inbox.dropped == blobs._MOST_IMAGES + 5
    inbox.close()
