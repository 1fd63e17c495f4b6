"""Scenarios: what happens in the true world, and what must then hold in the working memory."""
