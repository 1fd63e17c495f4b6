"""What touches, rests on and contains what, and poses that physics allows."""
