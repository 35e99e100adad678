"""The physics of elastically coupled beams with piezoelectric patches: structure file -> matrices."""
