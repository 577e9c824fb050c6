"""Universal Robots: a state publisher over RTDE, and a server that stands in for a robot."""
