"""The `dsr` command: start systems, and look into a running working memory."""
