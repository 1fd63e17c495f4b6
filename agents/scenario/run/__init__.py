"""Runs of scenarios: one or many, in lockstep or live, and what people see of them."""
