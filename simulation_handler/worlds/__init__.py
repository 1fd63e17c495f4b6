"""The belief as a set of weighted worlds: what they are, how they are proposed, weighed and learned."""
