"""The autonomous agents around the working memory, one small package each."""
