"""The state publisher of a Franka arm: `drive.py` is its loop."""
