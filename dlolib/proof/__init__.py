"""The blind proof: a laboratory of its own, whose recordings hold what it alone knows, and their scoring."""
