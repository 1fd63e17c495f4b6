"""The physics reasoner of Sallami et al. as it was published, beside which the belief is measured.

`parameters` (Table I), `reasoner` (Algorithms 1 and 2). Its faults are kept: docs/explanation/published_reasoner.md.
"""
