"""The virtual laboratory: a rope in MuJoCo, a depth camera, and an exact elastica to check the rope by."""
