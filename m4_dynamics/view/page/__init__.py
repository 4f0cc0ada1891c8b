"""Template, style and script of the replay page."""
