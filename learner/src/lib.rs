//! Learns a frozen model from demonstrations.
