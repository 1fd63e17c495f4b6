"""Skills that the arm performs by itself: pick, place, move, observe, stop."""
