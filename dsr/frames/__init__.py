"""Where one frame is, seen from another: chains of geometric edges over time."""
