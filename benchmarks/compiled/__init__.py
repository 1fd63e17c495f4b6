"""Measures what a compiled core of the memory would gain, by a prototype in C++ that is built when it is measured."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the system that is measured is forked: beside threads it cannot be
