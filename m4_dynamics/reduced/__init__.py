"""The planar mobile inverted pendulum, its ground forces and trims (paper, sections III-B and III-C)."""
