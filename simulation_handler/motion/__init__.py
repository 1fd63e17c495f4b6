"""Bodies that move: driven, carried along, held, spilled, and corrected by perception."""
