"""The true course of a scenario: samples of a run, and the relations, actions and phases read off them."""
