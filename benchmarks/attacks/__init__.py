"""Attacks on a working memory by a peer that speaks its protocol; what must hold is in docs/how-to/security.md."""
