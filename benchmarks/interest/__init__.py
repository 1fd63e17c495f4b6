"""What interest comes to: histories under faults, wrong designs that they show, and what it costs."""
