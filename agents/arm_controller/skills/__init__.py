"""What the arm can do by itself: pick, place, move, observe, stop."""
