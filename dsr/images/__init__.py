"""Camera frames as streams of binary blobs."""
