"""Ways of an arm: found free of obstacles, timed within limits, followed, and announced to other arms."""
