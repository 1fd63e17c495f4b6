"""Relations begin and end with hysteresis."""

from __future__ import annotations

from simulation_handler.contact.relations import ContactRelations, resting
from simulation_handler.physics.simulator import Contact

ON = ("cube", "table")


def test_a_contact_must_last() -> None:
    relations = ContactRelations(delay=0.25)
    relations.update([ON], 10.0)
    relations.update([ON], 10.125)
    assert relations.current() == {}
    relations.update([ON], 10.25)
    assert relations.current() == {ON: 10.0}


def test_a_passing_touch_begins_nothing() -> None:
    relations = ContactRelations(delay=0.25)
    for now in (10.0, 10.125, 10.25, 10.375):
        relations.update([ON] if now in (10.0, 10.25) else [], now)
    relations.update([ON], 10.5)
    assert relations.current() == {}


def test_a_short_loss_of_contact_ends_nothing() -> None:
    relations = ContactRelations(delay=0.25)
    for now in (10.0, 10.25):
        relations.update([ON], now)
    relations.update([], 10.375)
    relations.update([ON], 10.5)
    relations.update([], 10.625)
    assert relations.current() == {ON: 10.0}
    relations.update([], 10.75)
    assert relations.current() == {}


def test_side_contacts_are_no_support() -> None:
    relations = ContactRelations(delay=0.0)
    relations.update(resting([Contact("a", "b", 0.0, 0.05), Contact(*ON, 0.0, 1.0)]), 10.0)
    assert relations.current() == {ON: 10.0}


def test_relations_recalled_and_forgotten() -> None:
    relations = ContactRelations(delay=0.25)
    relations.recall(ON, 3.0, 10.0)
    assert relations.current() == {ON: 3.0}
    relations.update([ON], 10.125)
    assert relations.current() == {ON: 3.0}
    relations.forget("table")
    assert relations.current() == {}
