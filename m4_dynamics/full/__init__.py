"""The full-body model on compliant ground (paper, section III-A)."""
