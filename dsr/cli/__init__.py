"""The `dsr` command: start systems, and look into a running working memory."""

from dsr.runtime.resources import exit_if_short

exit_if_short()  # before any module of a command loads a library that would crash
