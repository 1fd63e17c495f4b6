"""Scenarios: events in the true world, and expectations of the working memory."""
