//! Frozen model files and RON configuration, parsed into valid types.
