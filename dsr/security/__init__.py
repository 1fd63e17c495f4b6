"""Restricts who takes part in a working memory and writes which types: certificates, policy, checks of messages."""
