"""Relations of contact between objects (touching, resting on, containing), and poses that physics allows."""
