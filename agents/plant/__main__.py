"""`python -m agents.plant`: the simulated reality as a process."""

from __future__ import annotations

from agents.plant.plant import Plant
from dsr import main

if __name__ == "__main__":
    main(Plant)
