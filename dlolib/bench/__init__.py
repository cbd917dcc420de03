"""Our rod as others' benchmarks take it."""
