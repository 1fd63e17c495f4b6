"""What a run is judged by: expectations that hold or fail, metrics, the result."""
