"""Trajectory in, picture out: scene, plots, tables of figures."""
