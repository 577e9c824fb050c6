//! Serial chains from URDF: kinematics and dynamics of fixed size.
