"""Robot description: URDF + SRDF + TOML in, one `Robot` out."""
