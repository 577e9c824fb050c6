"""Bridge between the pybullet simulator and the controller's shared-memory services."""

__version__ = "0.1.0"
