"""QP-linearised model predictive control of the pendulum (paper, section IV)."""
