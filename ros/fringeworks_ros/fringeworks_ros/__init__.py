"""A fringe projection scanner as a ROS 2 node."""
