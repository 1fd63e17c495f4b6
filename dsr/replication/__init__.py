"""How replicas stay equal: messages, synchronisation, and what a sender may claim."""
