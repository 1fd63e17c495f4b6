"""Keeps replicas equal: messages, synchronisation, and the claims that a sender may make."""
