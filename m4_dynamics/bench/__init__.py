"""Peers of the hot paths, for `m4 bench`."""
