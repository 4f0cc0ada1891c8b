"""Robots and ground as a drawn picture, without a graphics card: a camera, solids, a depth buffer, light and shadow."""
