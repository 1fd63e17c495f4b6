"""How accurate is perception on recordings of others? Ours beside its peers, in the same run."""
