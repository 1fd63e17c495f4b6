"""The real model of hands, MediaPipe's: its file, where it comes from, and the two programs that can run it."""
