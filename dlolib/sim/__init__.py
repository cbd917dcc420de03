"""The rod of Section IV in Taichi: the direct solver, the paper's iterative one, contact, derivatives."""
