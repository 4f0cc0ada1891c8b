"""Controllers on the reduced model."""
