"""Agents of my_robot around the working memory."""
