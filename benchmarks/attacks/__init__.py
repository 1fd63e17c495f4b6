"""Attacks on a working memory by a peer that speaks its protocol, each with what must hold (docs/security.md)."""
