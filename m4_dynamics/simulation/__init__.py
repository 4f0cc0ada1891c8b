"""Closed-loop simulation on the full model."""
